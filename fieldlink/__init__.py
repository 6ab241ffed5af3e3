"""The adapter: everything that touches a wire, a clock, a disk or a person."""
