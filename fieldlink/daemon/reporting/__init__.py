"""What the daemon says: records, log lines, snapshots, messages to systemd."""
