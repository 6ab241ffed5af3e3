"""Whether the PLC takes OP from the register to which it is written."""

from __future__ import annotations

import math

__all__ = ["OpWatch"]

TOLERANCE = 0.01
"""Share of OP's range by which OP may differ from what was written: registers round, and a PLC may
smooth. The smallest stick band that matters is about as large."""


class OpWatch:
    """Compares the OP that is read with the one that was written in the scan before.

    A PLC may show OP a scan late, or move it at a limited rate: what is between the last two that
    were written, or comes nearer, follows.

    Args:
        span: range of OP that may be written.
        patience: scans in a row without following after which the PLC does not take OP.
    """

    def __init__(self, span: float, patience: int) -> None:
        self._tolerance = TOLERANCE * span
        self._patience = patience
        self._written: tuple[float, float] | None = None
        self._distance = math.inf
        self._scans = 0

    def wrote(self, op: float) -> None:
        """Note what was written in this scan."""
        self._written = (op if self._written is None else self._written[1], op)

    def wrote_nothing(self) -> None:
        """Note that another one has OP: there is nothing to compare."""
        self._written, self._distance, self._scans = None, math.inf, 0

    def look(self, op: float) -> bool:
        """Return whether the PLC takes OP, by what is read of it now."""
        if self._written is None:
            return True
        low, high = min(self._written), max(self._written)
        distance = max(0.0, low - op, op - high)
        before, self._distance = self._distance, distance
        follows = distance <= self._tolerance or distance < before - 0.1 * self._tolerance
        self._scans = 0 if follows else self._scans + 1
        return self._scans <= self._patience
