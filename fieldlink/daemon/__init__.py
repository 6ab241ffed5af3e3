"""Sampling, windows, the estimator pool, write-back, health."""
