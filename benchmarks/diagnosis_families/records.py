"""Records of loops with their true causes, as both families return them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CAUSES", "SOURCES", "EventRecord", "LoopRecord"]

Floats = NDArray[np.float64]

CAUSES = (
    "sticky_valve", "external_oscillation", "tight_tuning", "slow_tuning", "saturation",
    "characteristic", "sensor", "manual", "quiet",
)  # fmt: skip
"""Causes that a family draws; the program may also answer ``undetermined``."""

SOURCES = ("sticky_valve", "tight_tuning", "outside", "none")
"""What an event of a plant may start from."""


@dataclass(frozen=True, slots=True)
class LoopRecord:
    """One simulated loop as recorded; arrays ``(n,)``, NaN where a sample is missing.

    ``causes`` are true of it, the first one first; ``settings`` are gain, integral and derivative
    time (seconds; infinite and 0 where absent) of its controller; ``cycle_s`` is the period of the
    oscillation that was put in from outside, NaN without one.
    """

    name: str
    causes: tuple[str, ...]
    op: Floats
    pv: Floats
    sp: Floats
    auto: NDArray[np.bool_]
    period: float
    settings: tuple[float, float, float]
    noise: float
    cycle_s: float
    notes: str


@dataclass(frozen=True, slots=True)
class EventRecord:
    """A plant over some hours: its loops, what it starts from, and who swings with it.

    ``origin`` is the name of the source loop, None where the disturbance came from outside or
    there is none; ``members`` are the loops whose PV the event moves visibly.
    """

    name: str
    plant: str
    source: str
    origin: str | None
    members: tuple[str, ...]
    cascades: tuple[tuple[str, str], ...]
    loops: dict[str, LoopRecord]
