"""Healthy and sticky valve as two hypotheses about the same rows, and what speaks for which."""
