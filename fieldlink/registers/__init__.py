"""Pure register arithmetic: types and word orders, read plans, parameter blocks."""
