"""What a hypothesis costs: least squares of the linear part, the noise model, the likelihood."""
