"""How sure: the posterior of the valve and what it says about each quantity.

The best hypothesis is given; nothing here changes it.
"""
