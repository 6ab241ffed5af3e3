"""Who has the loop: what is asked of a model before, and of the loop while it is compensated."""
