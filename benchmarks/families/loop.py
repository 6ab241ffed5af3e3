"""A loop as a historian holds it, with the truth about its valve beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Law", "RecordedLoop"]

Law = Literal["he", "kano", "sliding", "karnopp", "lugre", "none"]


@dataclass(frozen=True, slots=True)
class RecordedLoop:
    """One simulated loop: its record and what is true of its valve.

    ``op``, ``pv`` and ``sp`` have shape ``(n,)``; a missing sample is NaN. ``period`` is the time
    between samples in seconds. ``stick_band`` S and ``slip_jump`` J are in units of OP, 0 for a
    healthy valve, whose ``law`` is "none". ``assessable`` is False where the record does not hold
    what any method would need. ``strokes`` counts the stem's runs in one direction.
    """

    name: str
    kind: str
    op: NDArray[np.float64]
    pv: NDArray[np.float64]
    sp: NDArray[np.float64] | None
    period: float
    stick_band: float
    slip_jump: float
    law: Law
    assessable: bool
    strokes: int
    notes: str
