"""How sure: the posterior of the valve and what it says about each quantity."""
