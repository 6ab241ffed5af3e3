"""Numbers as a reader expects them in a sentence: few digits, and no powers of ten."""

from __future__ import annotations

import math

__all__ = ["digits"]


def digits(value: float, count: int) -> str:
    """The value with ``count`` significant digits; large ones in full: 12300, not 1.23e+04."""
    text = f"{value:.{count}g}"
    return f"{float(text):.0f}" if math.isfinite(value) and abs(value) >= 10.0**count else text
