"""A stem as its slips, found by a compiled walk along OP.

He's valve in the coordinates of its last slip: ``h`` is OP at that slip and ``s`` its direction, so
that the stem stands at ``x = h - s fD``. It goes on in direction ``s`` when OP has moved on by more
than ``J``, and turns when OP has come back by more than ``S`` (equation (4) of the paper, with
``S = fS + fD`` and ``J = fS - fD``). A window of a thousand samples has a few dozen slips; whatever
least squares needs of a stem is a sum over them, which is what makes the search quick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "Array",
    "Index",
    "Op",
    "first_leads",
    "kernel",
    "offset_of",
    "op_of",
    "slip_patterns",
    "slips",
    "slips_into",
    "usual_span",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile a loop; the code is kept beside its source."""
    compiled = njit(cache=True, fastmath=True, error_model="numpy")(function)
    return cast("_Function", compiled)


_BLOCK = 8


class Op(NamedTuple):
    """OP, shape ``(n,)``, with the extremes of every eight samples, by which a walk skips."""

    u: Array
    top: Array
    bottom: Array


def op_of(u: Array) -> Op:
    """OP made ready for walks."""
    blocks = -(-u.size // _BLOCK)
    padded = np.concatenate([u, np.full(blocks * _BLOCK - u.size, u[-1])]).reshape(blocks, _BLOCK)
    return Op(np.ascontiguousarray(u), padded.max(axis=1), padded.min(axis=1))


def first_leads(u: Array, first: float) -> Array:
    """One lead for every sample at which a first slip in this direction can happen.

    Where OP jumps, any lead on its way makes the same slip; the least one lets most valves do so.
    """
    records = np.unique(np.maximum.accumulate(first * (u - u[0])))
    gaps = np.diff(records)
    if gaps.size == 0:
        return gaps
    leads: Array = records[:-1] + 0.5 * np.minimum(gaps, float(np.median(np.abs(np.diff(u)))))
    return leads


def usual_span(u: Array) -> float:
    """The span of OP without the short excursions of a set-point step; at most its span."""
    low, high = np.quantile(u, (0.1, 0.9))
    return float(min(np.ptp(u), 1.25 * (high - low)))


@kernel
def slips_into(
    op: Op,
    band: float,
    jump: float,
    lead: float,
    first: float,
    at: Index,
    step: Array,
) -> int:
    """Samples ``at`` of the slips and the stem's change ``step`` at each; returns how many.

    ``first`` is the direction of the first slip, ``lead`` how far OP goes until then. Zero where no
    valve could stand like that: the stem is never further from OP than ``fS``.
    """
    if lead > band + jump or lead < 0.0 or jump > band:
        return 0
    friction = 0.5 * (band - jump)
    s = -first
    h = op.u[0] - first * (band - lead)
    up = h + (jump if s > 0.0 else band)
    down = h - (band if s > 0.0 else jump)
    count = 0
    for b in range(op.top.size):
        if op.top[b] <= up and op.bottom[b] >= down:
            continue
        for k in range(_BLOCK * b, min(_BLOCK * b + _BLOCK, op.u.size)):
            v = op.u[k]
            if v > up:
                at[count] = k
                step[count] = v - h - friction * (1.0 - s)
                count += 1
                h, s, up, down = v, 1.0, v + jump, v - band
            elif v < down:
                at[count] = k
                step[count] = v - h + friction * (1.0 + s)
                count += 1
                h, s, up, down = v, -1.0, v + band, v - jump
    return count


@kernel
def _spared(op: Op, band: float, jump: float, lead: float, first: float) -> tuple[float, float]:
    """How far OP came back and how far it went on between slips, without another slip.

    Valves of a stick band and a slip jump down to these slip at the same samples. Negative where
    the first slip is not in the direction ``first``, or none happens.
    """
    s = -first
    h = op.u[0] - first * (band - lead)
    up = h + (jump if s > 0.0 else band)
    down = h - (band if s > 0.0 else jump)
    back, on, slipped = 0.0, 0.0, False
    for b in range(op.top.size):
        if op.top[b] <= up and op.bottom[b] >= down:
            if slipped:
                above, below = op.top[b] - h, h - op.bottom[b]
                back = max(back, below if s > 0.0 else above)
                on = max(on, above if s > 0.0 else below)
            continue
        for k in range(_BLOCK * b, min(_BLOCK * b + _BLOCK, op.u.size)):
            v = op.u[k]
            if v > up or v < down:
                s = 1.0 if v > up else -1.0
                if not slipped and s != first:
                    return -1.0, -1.0
                slipped = True
                h = v
                up = h + (jump if s > 0.0 else band)
                down = h - (band if s > 0.0 else jump)
            elif slipped:
                back, on = max(back, s * (h - v)), max(on, s * (v - h))
    if not slipped:
        return -1.0, -1.0
    return back, on


@kernel
def slip_patterns(
    op: Op, regions: Array, starts: Array, least: Array, widest: float, most: int
) -> tuple[Array, Index]:
    """All valves of regions that slip differently, as smaller regions, and where each belongs.

    ``regions`` has shape ``(m, 4)``: ends of the stick band, ends of the slip jump; ``starts``
    ``(m, 2)``: lead and direction of the first slip. A region that comes back slips like its valve
    of the widest stick band, except for differences within ``least`` (in S, in J); it is no wider
    than ``widest`` in J, because the stem still depends on J. At most ``most`` come back.
    """
    found, of = np.empty((most, 4)), np.empty(most, np.int64)
    stack = np.empty((256, 4))
    count = 0
    for i in range(starts.shape[0]):
        stack[0] = regions[i]
        height = 1
        while height > 0 and count < most:
            height -= 1
            s0, s1, j0, j1 = stack[height]
            j1 = min(j1, s1)
            if s1 <= s0 or j1 < j0 - 1e-9:
                continue
            back, on = _spared(op, s1, j1, starts[i, 0], starts[i, 1])
            if back < 0.0:
                continue
            s_end = max(s0, min(back, s1 - least[0]))
            j_end = max(j0, min(on, j1 - least[1]))
            parts = max(1, int(np.ceil((j1 - j_end) / widest)))
            for part in range(parts):
                if count < most:
                    found[count, 0], found[count, 1] = s_end, s1
                    found[count, 2] = j_end + (j1 - j_end) * part / parts
                    found[count, 3] = j_end + (j1 - j_end) * (part + 1) / parts
                    of[count] = i
                    count += 1
            if s_end > s0 and height < 254:
                stack[height] = (s0, s_end - 1e-12, j0, j1)
                height += 1
            if j_end > j0 and height < 254:
                stack[height] = (s_end, s1, j0, j_end - 1e-12)
                height += 1
    return found[:count], of[:count]


@kernel
def offset_of(index: int, count: int) -> float:
    """Node ``index`` of ``count`` from -1 to 1, 0 where there is one only."""
    return 2.0 * index / (count - 1) - 1.0 if count > 1 else 0.0


def slips(op: Op, band: float, jump: float, lead: float, first: float) -> tuple[Index, Array]:
    """Samples and sizes of the slips of one valve; see :func:`slips_into`."""
    at, step = np.empty(op.u.size, dtype=np.int64), np.empty(op.u.size)
    count = slips_into(op, band, jump, lead, first, at, step)
    return at[:count], step[:count]
