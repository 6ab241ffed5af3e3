"""A time column in seconds, and the error of a column that holds none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["NoClockError", "Times"]


class NoClockError(ValueError):
    """A column without a readable time; ``index`` is the row at fault, if one is."""

    def __init__(self, message: str, index: int | None = None) -> None:
        self.index = index
        super().__init__(message)


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """A time column in seconds.

    Attributes:
        seconds: one for each cell, NaN for an empty one.
        origin: seconds since 1970 (UTC) when ``seconds`` is 0, None without a date.
        is_local: whether the dates name no offset from UTC.
        note: how the column was read, where that is not plain.
        is_unit_known: whether the times are certainly seconds; False for bare numbers.
    """

    seconds: NDArray[np.float64]
    origin: float | None
    is_local: bool = False
    note: str | None = None
    is_unit_known: bool = True
