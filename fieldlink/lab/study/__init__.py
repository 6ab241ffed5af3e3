"""Closed loops of any controller with any plant, in plain simulation: figures to judge by."""
