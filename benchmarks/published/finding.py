"""What a published method finds in one window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["Call", "Finding"]

Call = Literal["stiction", "no_stiction", "undecided", ""]


@dataclass(frozen=True, slots=True)
class Finding:
    """A verdict ("" where the method gives none), a score that grows with stiction, and S and J.

    S and J are in units of OP, NaN where the method does not size them.
    """

    call: Call
    score: float
    stick_band: float = math.nan
    slip_jump: float = math.nan
