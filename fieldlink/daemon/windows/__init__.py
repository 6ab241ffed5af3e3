"""The last samples of a loop, equally spaced, and the requests for estimates made of them.

No socket and no clock: a sample comes in with its slot.
"""
