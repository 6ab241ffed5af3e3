"""The adapter: everything that touches a wire, a clock, a disk or a person.

The numeric cores `estimator`, `compensator` and `fmu_models` are used here and know nothing of it.
"""
