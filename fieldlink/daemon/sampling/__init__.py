"""Scans of a device on monotonic deadlines: a slot for every reading, an account of every slot.

Nothing here writes to a device or looks at what a sample means.
"""
