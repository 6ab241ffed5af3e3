"""Yamashita's qualitative shapes: how much of the time does PV rest while OP moves?

Source: Yamashita (2006), "An automatic method for detection of valve stiction in process control
loops", Control Engineering Practice 14, 503-510. Made for flow loops, where PV shows the stem.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.published.cycles import average_blocks, crossings, process_sign
from benchmarks.published.finding import Finding

__all__ = ["count_shapes"]

Array = NDArray[np.float64]

STICKY = 0.25
"""Share of the time above which the paper decides: that of a sine, by chance."""
STILL = 0.5
"""A step below this many deviations of the steps counts as rest, normalised as in the paper."""
CYCLE = 25
"""Samples that a cycle is averaged to: the paper wants a sampling at which noise makes no step."""

_EXCLUDED = {
    (1, 0): {(-1, -1), (-1, 1), (0, -1), (1, -1), (-1, 0)},
    (-1, 0): {(-1, 1), (0, 1), (1, -1), (1, 1), (1, 0)},
}
"""What may not follow (OP rises, PV rests) and (OP falls, PV rests): rules of the index rho 3."""


def _symbols(signal: Array) -> NDArray[np.int64]:
    steps = np.diff(signal)
    still = STILL * float(steps.std())
    return np.where(steps > still, 1, np.where(steps < -still, -1, 0)).astype(np.int64)


def count_shapes(op: Array, pv: Array) -> Finding:
    """Index rho 3 as score: time in shapes that only a sticking valve explains, rests left out."""
    ends = crossings(op - op.mean())
    cycle = 2.0 * float(np.median(np.diff(ends))) if len(ends) > 2 else CYCLE
    size = max(1, int(cycle / CYCLE))
    pv = process_sign(op, pv) * average_blocks(pv, size)
    op = average_blocks(op, size)
    shapes = list(zip(_symbols(op).tolist(), _symbols(pv).tolist(), strict=True))
    busy = sum(shape != (0, 0) for shape in shapes)
    if busy == 0:
        return Finding("undecided", 0.0)
    sticking, run = 0, 0
    for now, after in zip(shapes, [*shapes[1:], (0, 0)], strict=True):
        if now not in _EXCLUDED:
            run = 0
            continue
        run += 1
        if after != now:
            sticking += 0 if after in _EXCLUDED[now] else run
            run = 0
    index = sticking / busy
    return Finding("stiction" if index > STICKY else "no_stiction", index)
