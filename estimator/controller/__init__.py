"""The running controller, read off the record: its law and its settings."""
