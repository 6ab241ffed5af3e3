"""Methods of others, as published: the paper's grid and its optimisation of the smoothed model.

They answer in the form of `identify`; the verdict is never theirs.
"""
