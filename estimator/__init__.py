"""Valve stiction from OP and PV: arrays in, result out."""
