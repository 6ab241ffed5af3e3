"""Simulated control loops with known valves: one family to choose numbers by, one to report by.

The two share no plant, valve or controller.
"""
