"""The historian."""
