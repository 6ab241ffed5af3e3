"""What the daemon says: records, log lines, snapshots, messages to systemd.

Nothing here decides anything.
"""
