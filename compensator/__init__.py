"""Controllers on a loop model: parameters and measurements in, OP out."""
