"""The whole chain in one command: a simulated PLC, the daemon, the compensator, and a report."""
