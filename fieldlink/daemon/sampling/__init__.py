"""Scans of a device on monotonic deadlines: a slot for every reading, an account of every slot.

How a device is read is `links`'; what is made of samples is `windows`'.
"""
