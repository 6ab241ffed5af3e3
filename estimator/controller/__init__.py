"""The running controller, read off the record: its law, its settings and its sign."""
