"""The resolution of PV: what a transmitter or a register rounds to is noise that nothing removes.

A PV that repeats one value looks free of noise, and the step to the next value then looks like a
load. So the variance of the rounding, a twelfth of the quantum's square, is the least noise that a
filter may assume (Widrow, B. and Kollar, I., 2008, *Quantization Noise*).
"""

from __future__ import annotations

import math

__all__ = ["PvResolution"]


class PvResolution:
    """Learns the quantum of a signal: the smallest change between successive values.

    A signal with more noise than rounding changes by ever smaller steps, so that its quantum tends
    to zero and counts for nothing.

    Args:
        changes: changes that must have been seen before their smallest one is believed.
    """

    def __init__(self, changes: int = 6) -> None:
        self._changes = changes
        self._seen = 0
        self._smallest = math.inf
        self._last = math.nan

    @property
    def variance(self) -> float:
        """Variance of the rounding, 0 while the quantum is not known."""
        return self._smallest**2 / 12.0 if self._seen >= self._changes else 0.0

    def push(self, value: float) -> None:
        """Take in a value; NaN says nothing."""
        if not math.isfinite(value):
            return
        change = abs(value - self._last)
        if change > 0.0:
            self._seen += 1
            self._smallest = min(self._smallest, change)
        self._last = value
