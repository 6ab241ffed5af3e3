"""Closed loops of any controller with any plant, in plain simulation: figures to judge by.

No socket and no daemon: what `simulate` and the benchmarks share.
"""
