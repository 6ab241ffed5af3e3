"""Healthy and sticky valve as two hypotheses about the same rows, and the evidence for each.

Candidates come from `search`, costs from `criteria`; the verdict is made here alone.
"""
