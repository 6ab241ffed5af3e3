"""Closed loops of any controller with any plant, in plain simulation: figures to judge by.

No registers, no daemon and no wall clock: what needs a PLC is in `plc` and `rehearse`.
"""
