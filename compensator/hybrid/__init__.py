"""The compensator that plans in valve positions: which moves, their price, and the OP for them."""
