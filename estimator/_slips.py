"""A stem as its slips, found by a compiled walk along OP.

He's valve in the coordinates of its last slip: ``h`` is OP at that slip and ``s`` its direction, so
that the stem stands at ``x = h - s fD``. It goes on in direction ``s`` when OP has moved on by more
than ``J``, and turns when OP has come back by more than ``S`` (equation (4) of the paper, with
``S = fS + fD`` and ``J = fS - fD``). A window of a thousand samples has a few dozen slips; whatever
least squares needs of a stem is a sum over them, which is what makes the search quick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Index, kernel

__all__ = [
    "BLOCK",
    "FirstSlips",
    "Op",
    "first_slips",
    "offset_of",
    "op_of",
    "slips",
    "slips_into",
    "step_of",
    "usual_span",
    "valves_around",
]

BLOCK = 8
"""Samples that a walk skips at once where they stay inside the stick band."""


class Op(NamedTuple):
    """OP, shape ``(n,)``, with the extremes of every eight samples, by which a walk skips."""

    u: Array
    top: Array
    bottom: Array


def op_of(u: Array) -> Op:
    """OP made ready for walks."""
    blocks = -(-u.size // BLOCK)
    padded = np.concatenate([u, np.full(blocks * BLOCK - u.size, u[-1])]).reshape(blocks, BLOCK)
    return Op(np.ascontiguousarray(u), padded.max(axis=1), padded.min(axis=1))


class FirstSlips(NamedTuple):
    """The samples at which a first slip in one direction can happen, by how far OP goes until then.

    A first slip is at sample ``i`` where the lead is between ``feet[i]`` and ``gaps[i]`` more;
    ``leads[i]`` is one of them. Where OP jumps, any lead on its way makes the same slip; a small
    one lets most valves do so. Shape ``(m,)`` each.
    """

    leads: Array
    feet: Array
    gaps: Array

    def of(self, lead: float) -> int:
        """Which one a lead makes; the nearest where it makes none."""
        return max(0, int(np.searchsorted(self.feet, lead, side="right")) - 1)


def first_slips(u: Array, first: float) -> FirstSlips:
    """All first slips of OP ``u``, ``(n,)``, in the direction ``first``."""
    records = np.unique(np.maximum.accumulate(first * (u - u[0])))
    feet, gaps = records[:-1], np.diff(records)
    if gaps.size == 0:
        return FirstSlips(gaps, feet, gaps)
    leads = feet + 0.5 * np.minimum(gaps, float(np.median(np.abs(np.diff(u)))))
    return FirstSlips(leads, feet, gaps)


def usual_span(u: Array) -> float:
    """The span of OP without the short excursions of a set-point step; at most its span."""
    low, high = np.quantile(u, (0.1, 0.9))
    return float(min(np.ptp(u), 1.25 * (high - low)))


def step_of(op: Array) -> float:
    """What OP (shape ``(n,)``) usually moves from sample to sample, where it moves."""
    steps = np.abs(np.diff(op))
    return float(np.median(steps[steps > 0.0]))


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
        for k in range(BLOCK * b, min(BLOCK * b + BLOCK, op.u.size)):
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
def offset_of(index: int, count: int) -> float:
    """Node ``index`` of ``count`` from -1 to 1, 0 where there is one only."""
    return 2.0 * index / (count - 1) - 1.0 if count > 1 else 0.0


@kernel
def valves_around(centre: Array, half: Array, counts: Index) -> Array:
    """Valves of a box, ``(m, 3)``: S, J and lead, ``half`` as far each way from ``centre``.

    J is kept between nothing and S; ``counts`` says how many of each.
    """
    found = np.empty((counts[0] * counts[1] * counts[2], 3))
    i = 0
    for a in range(counts[0]):
        band = centre[0] + half[0] * offset_of(a, counts[0])
        for b in range(counts[1]):
            jump = centre[1] + half[1] * offset_of(b, counts[1])
            for c in range(counts[2]):
                found[i, 0], found[i, 1] = band, min(max(jump, 0.0), band)
                found[i, 2] = centre[2] + half[2] * offset_of(c, counts[2])
                i += 1
    return found


def slips(op: Op, band: float, jump: float, lead: float, first: float) -> tuple[Index, Array]:
    """Samples and sizes of the slips of one valve; see :func:`slips_into`."""
    at, step = np.empty(op.u.size, dtype=np.int64), np.empty(op.u.size)
    count = slips_into(op, band, jump, lead, first, at, step)
    return at[:count], step[:count]
