"""Cascades, found from the data: a loop whose set-point is another loop's OP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.coherence import LoopSignals
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings
from estimator.window import bridge, carry_on

__all__ = ["Cascade", "find_cascades"]

_LOOKS = 1000
"""Times at which outputs and set-points are compared first: only the most alike are compared in
full, so that hundreds of loops take seconds."""


@dataclass(frozen=True, slots=True)
class Cascade:
    """``master``'s OP is ``slave``'s set-point, to within a scale; ``explained`` is its share."""

    master: str
    slave: str
    explained: float


def find_cascades(
    signals: Mapping[str, LoopSignals], settings: DiagnosisSettings = DIAGNOSIS
) -> tuple[Cascade, ...]:
    """Loops whose set-point is another loop's OP, found by regression; both must move."""
    found = []
    grouping = settings.grouping
    names = list(signals)
    grid, outputs = _outputs(signals)
    for slave, one in signals.items():
        sp = None if one.sp is None else carry_on(one.sp)
        if sp is None:
            continue
        # a cascade's set-point moves all the time
        if float(np.mean(np.diff(sp) != 0.0)) < grouping.moving:
            continue
        best: tuple[float, str] | None = None
        target = np.interp(grid, one.start_s + one.period * np.arange(sp.size), sp)
        alike = np.abs(outputs @ _standardised(target))
        for k in np.argsort(-alike)[: grouping.masters + 1]:
            master, other = names[int(k)], signals[names[int(k)]]
            if master == slave:
                continue
            explained = _explained(sp, one, bridge(other.op), other)
            if best is None or explained > best[0]:
                best = (explained, master)
        if best is not None and best[0] > grouping.cascade:
            found.append(Cascade(best[1], slave, best[0]))
    return tuple(found)


def _outputs(signals: Mapping[str, LoopSignals]) -> tuple[Array, Array]:
    """Common times ``(m,)``, and every loop's OP there without mean and size, ``(loops, m)``."""
    start = max(one.start_s for one in signals.values())
    stop = min(one.start_s + one.period * one.op.size for one in signals.values())
    grid = np.linspace(start, max(start, stop), _LOOKS)
    rows = [
        np.interp(grid, one.start_s + one.period * np.arange(one.op.size), bridge(one.op))
        for one in signals.values()
    ]
    return grid, np.array([_standardised(row) for row in rows])


def _standardised(x: Array) -> Array:
    centred = x - x.mean()
    size = float(np.sqrt(centred @ centred))
    return np.asarray(centred / size if size > 0.0 else centred)


def _explained(sp: Array, one: LoopSignals, op: Array, other: LoopSignals) -> float:
    """Share of the set-point's variance that a straight line of the other's OP explains."""
    at = one.start_s + one.period * np.arange(sp.size)
    have = other.start_s + other.period * np.arange(op.size)
    inside = (at >= have[0]) & (at <= have[-1])
    if inside.sum() < 20 or np.ptp(op) == 0.0:
        return 0.0
    best = 0.0
    for late in (0.0, one.period):
        x = np.interp(at[inside] - late, have, op)
        y = sp[inside]
        if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
            continue
        best = max(best, float(np.corrcoef(x, y)[0, 1]) ** 2)
    return best
