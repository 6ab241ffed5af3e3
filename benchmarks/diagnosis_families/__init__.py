"""Simulated loops and plants with known causes: `tuning` chooses numbers, `report` is judged.

The two share no plant, valve or controller.
"""
