"""Methods of others, as published: the paper's grid and its optimisation of the smoothed model."""
