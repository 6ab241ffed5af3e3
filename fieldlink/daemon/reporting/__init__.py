"""What the daemon says: records, log lines, snapshots, messages to systemd.

Nothing here decides: it writes down what the other parts have done.
"""
