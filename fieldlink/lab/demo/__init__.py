"""The whole chain in one command: a simulated PLC, the daemon, the compensator, and a report.

No simulation and no rule of its own: it starts what the other packages have.
"""
