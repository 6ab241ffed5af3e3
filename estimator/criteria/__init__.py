"""What a hypothesis costs: least squares of the linear part, the noise model, the likelihood.

No search and no verdict here: a hypothesis comes in, its likelihood goes out.
"""
