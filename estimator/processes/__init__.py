"""Processes between stem and PV: poles, dead time, their response and their ARX form.

Nothing here knows a valve or a verdict.
"""
