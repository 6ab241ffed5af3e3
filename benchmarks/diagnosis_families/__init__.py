"""Simulated loops and plants with known causes: `tuning` chooses numbers, `report` is judged."""
