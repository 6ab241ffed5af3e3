"""Compensators of the literature: the paper's stiction-embedding MPC, two moves, the knocker."""
