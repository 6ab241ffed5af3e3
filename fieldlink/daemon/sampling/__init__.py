"""A device's two tasks: scans on monotonic deadlines, with a slot for every reading; write-backs.

What a sample means (`windows`) and what is written (`writeback`) are not decided here.
"""
