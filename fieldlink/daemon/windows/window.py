"""The window of a loop: its last samples, each in its own slot, gaps left open.

Slots are numbered in periods of the loop. A sample goes where its number says: what is missing
stays NaN, what comes twice is dropped, and what is bad is NaN in its place. So the samples that the
estimator gets are equally spaced whatever happened on the wire.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LoopSample", "Window", "WindowData"]

Floats = NDArray[np.float64]

_SIGNALS = ("op", "pv", "sp", "auto", "utc")
"""The first fields of a `LoopSample`, in their order."""


class LoopSample(NamedTuple):
    """The signals of a loop from one scan; NaN where bad or absent.

    Attributes:
        op, pv, sp: engineering values.
        auto: 1 in automatic, 0 otherwise, NaN where there is no mode tag or it is bad.
        utc: seconds since 1970 when OP and PV were read.
        quality: code of the worse of OP's and PV's quality, 0 when both are good.
    """

    op: float
    pv: float
    sp: float
    auto: float
    utc: float
    quality: int = 0


@dataclass(frozen=True, slots=True)
class WindowData:
    """A copy of a window, oldest sample first; arrays have the shape ``(samples,)``.

    Attributes:
        op, pv: NaN where missing or bad.
        sp, auto: None where the loop has no such tag.
        first_slot, last_slot: numbers of the first and the last sample.
        end_utc: when the last sample was read, seconds since 1970.
    """

    op: Floats
    pv: Floats
    sp: Floats | None
    auto: Floats | None
    first_slot: int
    last_slot: int
    end_utc: float


class Window:
    """A ring of the last ``size`` slots.

    Args:
        size: samples.
        has_sp, has_auto: whether the loop has such tags.
    """

    def __init__(self, size: int, *, has_sp: bool = True, has_auto: bool = True) -> None:
        self._size = size
        self._has_sp = has_sp
        self._has_auto = has_auto
        # A row a slot: a sample is written in one piece.
        self._ring = np.full((size, len(_SIGNALS)), np.nan)
        self._first: int | None = None
        self._last = -1

    @property
    def size(self) -> int:
        """Samples of a full window."""
        return self._size

    @property
    def span(self) -> int:
        """Slots from the first to the last sample, gaps included; at most ``size``."""
        if self._first is None:
            return 0
        return min(self._size, self._last - self._first + 1)

    @property
    def is_full(self) -> bool:
        """Whether the window reaches back over all its slots."""
        return self.span == self._size

    @property
    def last_slot(self) -> int:
        """Number of the last sample's slot, -1 when there is none."""
        return self._last

    def put(self, slot: int, sample: LoopSample) -> int:
        """Put a sample into a slot and return how many slots before it stayed empty.

        Raises:
            ValueError: the slot is not after the last one.
        """
        if self._first is None:
            self._first, self._last = slot, slot - 1
        skipped = slot - self._last - 1
        if skipped < 0:
            raise ValueError(f"slot {slot} is not after slot {self._last}")
        if skipped:
            gap = np.arange(max(self._last + 1, slot - self._size), slot) % self._size
            self._ring[gap] = np.nan
        self._ring[slot % self._size] = sample[: len(_SIGNALS)]
        self._last = slot
        return skipped

    def restart(self) -> None:
        """Forget the samples; slots go on from the last one."""
        if self._first is not None:
            self._first = self._last + 1

    def data(self) -> WindowData:
        """Return a copy of what is there (shape ``(span,)``).

        Raises:
            ValueError: the window is empty.
        """
        if self.span == 0:
            raise ValueError("the window is empty")
        first = self._last - self.span + 1
        op, pv, sp, auto, utc = self._ring[np.arange(first, self._last + 1) % self._size].T.copy()
        return WindowData(
            op=op,
            pv=pv,
            sp=sp if self._has_sp else None,
            auto=auto if self._has_auto else None,
            first_slot=first,
            last_slot=self._last,
            end_utc=float(utc[-1]),
        )

    def good_share(self) -> float:
        """Share of the window's slots with good OP and PV; NaN when it is empty."""
        if self._first is None:
            return math.nan
        held = self.data()
        return float(np.mean(np.isfinite(held.op) & np.isfinite(held.pv)))
