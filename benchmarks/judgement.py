"""What the estimator says about a random loop, and the shares and errors of many of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from benchmarks.loops import Loop, named_loop
from benchmarks.recording import record
from estimator import identify

__all__ = ["CYCLE", "Judgement", "Share", "coverage", "judge", "relative_errors"]

CYCLE = 4
"""Turns of the stem that make a cycle visible in a window."""

Band = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the estimator said about a loop; ``turns`` as in `benchmarks.recording.Recording`.

    ``stick_band``, ``slip_jump`` are value, low and high, in percent of OP.
    """

    loop: Loop
    verdict: str
    reasons: tuple[str, ...]
    score: float
    stick_band: Band
    slip_jump: Band
    fit: tuple[float, float]
    turns: int
    seconds: float

    @property
    def is_false_alarm(self) -> bool:
        """A healthy valve called sticky."""
        return self.loop.is_healthy and self.verdict == "stiction"

    @property
    def is_missed(self) -> bool:
        """A sticky valve whose cycle is in the window, called healthy."""
        return not self.loop.is_healthy and self.turns >= CYCLE and self.verdict == "no_stiction"


def judge(loop: Loop | str, *, samples: int = 1000) -> Judgement:
    """Record a loop (``"s17"``, ``"h17"``) and let the estimator judge it."""
    if isinstance(loop, str):
        loop = named_loop(loop)
    trace = record(loop, samples=samples)
    result = identify(trace.op, trace.pv, sp=trace.sp)
    s, j = result.stick_band, result.slip_jump
    return Judgement(
        loop=loop,
        verdict=result.verdict.value,
        reasons=tuple(reason.code.value for reason in result.reasons),
        score=result.score,
        stick_band=(s.value, s.low, s.high),
        slip_jump=(j.value, j.low, j.high),
        fit=(result.fit.r2, result.fit.r2_healthy_valve),
        turns=trace.turns,
        seconds=result.seconds,
    )


@dataclass(frozen=True, slots=True)
class Share:
    """``hits`` of ``count``, with the 90 % interval of Clopper and Pearson (1934)."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.hits / self.count if self.count else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The exact interval; from 0 to 1 of nothing."""
        misses = self.count - self.hits
        low = float(beta.ppf(0.05, self.hits, misses + 1)) if self.hits else 0.0
        high = float(beta.ppf(0.95, self.hits + 1, misses)) if misses else 1.0
        return low, high

    def __str__(self) -> str:
        if self.count == 0:
            return ""
        low, high = self.interval
        return (
            f"{self.hits} of {self.count} = {100 * self.value:.1f} % "
            f"({100 * low:.1f} to {100 * high:.1f})"
        )


def relative_errors(found: Sequence[Judgement]) -> np.ndarray:
    """Errors of S in percent of S, shape ``(len(found),)``."""
    return np.array([100.0 * (o.stick_band[0] / o.loop.stick_band - 1.0) for o in found])


def coverage(found: Sequence[Judgement], quantity: str) -> Share:
    """How many intervals of ``"stick_band"`` or ``"slip_jump"`` hold the true value."""
    held = 0
    for one in found:
        _, low, high = getattr(one, quantity)
        held += bool(low <= getattr(one.loop, quantity) <= high)
    return Share(held, len(found))
