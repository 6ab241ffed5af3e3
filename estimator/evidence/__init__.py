"""Healthy and sticky valve as two hypotheses about the same rows, and what speaks for which.

Candidates come from `search`, costs from `criteria`; the verdict is made here alone.
"""
