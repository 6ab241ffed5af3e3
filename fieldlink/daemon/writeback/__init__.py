"""Findings into the parameter block of a PLC, by rules that are checked when it is written.

Every write to an exchange area of the daemon goes through here, and nothing else is written.
"""
