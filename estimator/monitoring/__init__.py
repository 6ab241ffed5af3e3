"""A valve over many windows: tracking, trend and changes; indices of a single window."""
