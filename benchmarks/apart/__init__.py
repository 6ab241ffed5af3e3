"""Plants, valves and loop controllers for reporting alone: nothing was tuned on them."""
