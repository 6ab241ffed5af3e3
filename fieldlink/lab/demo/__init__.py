"""The whole chain in one command: a simulated PLC, the daemon, the compensator, and a report.

Nothing of the daemon, its links or its store may need it.
"""
