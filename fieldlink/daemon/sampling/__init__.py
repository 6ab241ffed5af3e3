"""Scans of a device on monotonic deadlines: a slot for every reading, an account of every slot."""
