"""Findings into the parameter block of a PLC, by rules that are checked when it is written.

The only place that decides about writing to a PLC; it knows no window and no estimator.
"""
