"""Plants, valves and loop controllers for reporting alone: nothing was tuned on them.

No loop, valve or plant of `benchmarks.tuned` may be imported here.
"""
