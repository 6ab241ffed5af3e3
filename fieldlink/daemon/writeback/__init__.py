"""Findings into the parameter block of a PLC, by rules that are checked when it is written."""
