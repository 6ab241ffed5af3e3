"""Whatever finds candidates: processes for a stem, valves for a window."""
