"""What the compensation benchmark judges by itself: fall-backs in time, and curves left behind.

A controller that is worse than the stiction-unaware MPC has to be noticed within five periods. A
period is that of the unaware MPC's limit cycle in the same loop. Worse begins where PV's
mean square error over one period comes to lie above the unaware MPC's, and stays there until the
fall-back; the way to a new set-point (half the time that the figures leave out) is not looked at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.compensation_cases import SEGMENT, WARM, Case, segments
from compensator.supervising.figures import oscillation_period
from fieldlink.lab.study.closed_loop import Trace

__all__ = ["PERIODS", "Judgement", "best_at", "dominated", "judge"]

PERIODS = 5.0
_ALIKE = 1.2
"""PV's deviation after a fall-back, over that of the unaware MPC under all seeds, that counts as
the same: it is the same controller, with other luck in where its valve sticks."""

_MORE = 1.02
"""Factor above which a mean square counts as larger: windows of a cycle differ by as much."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Judgement:
    """One run against the unaware MPC under the same noise.

    Attributes:
        ratio: of the deviations of PV.
        noticed: periods from the beginning of the worse behaviour to the fall-back; NaN without.
        after: deviation in the steady samples from two periods after the fall-back on, over that
            of the unaware MPC under all seeds; NaN without.
        passed: not worse, or given back within `PERIODS` and no worse from then on.
    """

    ratio: float
    noticed: float
    after: float
    passed: bool


def judge(case: Case, trace: Trace, unaware: Sequence[Trace], lost_at: int | None) -> Judgement:
    """Judge a run that gave the loop back at ``lost_at`` (None: it did not).

    Args:
        case: of the run.
        trace: of the run.
        unaware: the unaware MPC's, first under the same noise, then under others.
        lost_at: scan of the fall-back.
    """
    ratio = _deviation(case, [trace], 0) / _deviation(case, unaware[:1], 0)
    if lost_at is None:
        return Judgement(ratio, math.nan, math.nan, ratio <= 1.0)
    errors = unaware[0].pv - unaware[0].sp
    period = round(oscillation_period(errors[WARM // 3 : WARM].tolist(), 60.0))
    noticed = (lost_at - _worse_since(case, trace, unaware[0], lost_at, period)) / period
    after = _deviation(case, [trace], lost_at + 2 * period) / _deviation(case, unaware, 0)
    better = math.isnan(after) or after <= _ALIKE
    return Judgement(ratio, noticed, after, ratio <= 1.0 or (noticed <= PERIODS and better))


def _deviation(case: Case, traces: Sequence[Trace], begin: int) -> float:
    """Return PV's standard deviation in the steady samples from ``begin`` on, each set-point's by
    itself; NaN where none has a hundred of them.
    """
    found = [
        float(np.var(trace.pv[max(first, begin) : last]))
        for trace in traces
        for first, last in segments(case)
        if last - max(first, begin) >= 100
    ]
    return math.sqrt(float(np.mean(found))) if found else math.nan


def _looked_at(case: Case, samples: int) -> NDArray[np.bool_]:
    """Samples that are not on the way to a new set-point."""
    looked = np.ones(samples, dtype=np.bool_)
    for step in (WARM, WARM + 60, WARM + 60 + SEGMENT):
        looked[step : step + case.settling // 2] = False
    looked[:WARM] = False
    return looked


def _worse_since(case: Case, trace: Trace, unaware: Trace, lost_at: int, period: int) -> int:
    """Return the sample since which PV's running mean square was above the unaware MPC's."""
    steady = np.concatenate([np.arange(*part) for part in [(WARM // 3, WARM), *segments(case)]])
    known = float(np.mean((unaware.pv - unaware.sp)[steady] ** 2))
    seen = np.flatnonzero(_looked_at(case, trace.pv.size)[:lost_at])
    squares = (trace.pv - trace.sp)[seen] ** 2
    if squares.size == 0:
        return lost_at
    since = seen.size
    for begin in range(seen.size - 1, -1, -1):
        window = squares[begin : begin + period]
        if float(np.mean(window)) <= _MORE * known and begin + period <= seen.size:
            break
        since = begin
    return int(seen[since]) if since < seen.size else lost_at


def best_at(curve: Sequence[Point], travel: float) -> float:
    """Return the least deviation that a controller reaches with at most ``travel``: of its points
    and of the straight lines between neighbours (settings between them exist); infinite if none.
    """
    points = sorted(curve)
    best = min((y for x, y in points if x <= travel), default=math.inf)
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        if x0 <= travel < x1:
            best = min(best, y0 + (y1 - y0) * (travel - x0) / (x1 - x0))
    return best


def dominated(curves: Mapping[str, Sequence[Point]], ours: str) -> list[str]:
    """Return words on every point of another controller that lies below our curve."""
    found = []
    for name, curve in curves.items():
        for travel, deviation in curve if name != ours else ():
            best = best_at(curves[ours], travel)
            if deviation < best:
                found.append(f"{name} at travel {travel:.3g}: {deviation:.3g} against {best:.3g}")
    return found
