"""The one-step criterion over all valves and dead times, along the window.

A stick band and a dead time trade against each other where OP ramps, so neither may be fixed while
the other is searched. And the longer a window, the narrower the right stick band: a slip that comes
a sample late moves the level from which the next one is counted, and so all that follow. No grid is
fine enough for a whole window. But which samples a valve slips at is a matter of the first slip,
and of the stick band from there on, so that the sets of slips can be listed without a gap. The
search lists them for the first strokes, keeps the best few hundred, and lists what each of these
becomes as the window grows.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Mask
from estimator._one_step import ScanTables, one_step_followed, one_step_scan
from estimator._slips import Index, Op, first_leads, op_of, slip_patterns, usual_span
from estimator.candidate import Candidate
from estimator.structures import COARSE

__all__ = ["one_step_seeds"]

_PAST = 3
"""Past values of PV in the regression; enough to rank, the orders are chosen later."""

_LONGEST = 20
_BANDS = (0.02, 0.06, 0.12, 0.25, 0.5, 1.05)
"""Ends of the stick bands that are listed, as shares of the usual span of OP."""
_RATIOS = (0.12, 0.3, 0.65)
"""Slip jumps of the first listing, as shares of the middle of these stick bands."""
_FACTORS = np.array([0.6, 1.0, 1.5])
_LEAST = 0.04
"""Sets of slips are told apart down to this share of OP's step per sample."""
_STROKE, _STROKES = 0.3, (6, 12)
"""A stroke as a share of the usual span, and how many are listed first: once each way, because
few strokes are ambiguous and many are listed coarsely."""
_GROWTH = 1.6
_TOP = 20_000
_KEPT = (600, 300, 150, 80, 40)
_BIN, _PER_BIN = 0.04, 4
_MOST = 40_000
_MOST_STARTS = 48


class _Beam(NamedTuple):
    """Valves that are followed: ends of S and J ``(m, 4)``, lead and first direction ``(m, 2)``,
    dead times and costs ``(m,)``."""

    regions: Array
    starts: Array
    delays: Index
    costs: Array

    def taken(self, index: Index) -> _Beam:
        return _Beam(self.regions[index], self.starts[index], self.delays[index], self.costs[index])

    @property
    def valves(self) -> Array:
        return _valves(self.regions, self.starts)


def one_step_seeds(op: Op, y: Array, good: Mask, count: int) -> tuple[Candidate, ...]:
    """The best valves, apart from each other in stick band or dead time: ``count`` of each listing.

    ``op`` and ``y`` are scaled OP and PV, shape ``(n,)``; ``good`` marks the samples that count.
    The candidates' process is none in particular, but for the dead time.
    """
    steps = np.abs(np.diff(op.u))
    step = float(np.median(steps[steps > 0.0]))
    span = usual_span(op.u)
    lengths = dict.fromkeys(_first_length(op.u, span, strokes) for strokes in _STROKES)
    found: list[Candidate] = []
    apart = 0.4 * step
    for length in lengths:
        beam = _grown(op, y, good, length, step, span)
        enough = len(found) + count
        ranked = zip(beam.valves, beam.delays, beam.costs, strict=True)
        for (band, jump, lead, first), delay, cost in ranked:
            if len(found) == enough:
                break
            dead_time = int(delay)
            if all(abs(s.band - band) > apart or abs(s.dead_time - dead_time) > 1 for s in found):
                valve = float(band), float(jump), float(lead), float(first)
                found.append(Candidate(float(cost), *valve, COARSE[0], dead_time))
    return tuple(found)


def _grown(op: Op, y: Array, good: Mask, length: int, step: float, span: float) -> _Beam:
    """The valves that are left at the end of the window, first listed in its first samples."""
    n = op.u.size
    delays = min(_LONGEST, n // 12)
    part = op_of(op.u[:length])
    beam = _listed(part, _tables(y[:length], good[:length], delays), step, span)
    stage = 0
    while length < n:
        length, stage = min(n, int(length * _GROWTH) + 1), min(stage + 1, len(_KEPT) - 1)
        part = op_of(op.u[:length])
        tables = _tables(y[:length], good[:length], delays)
        beam = _followed(part, tables, beam, step, span, stage)
    return beam


def _first_length(u: Array, span: float, most: int) -> int:
    """Samples of the first strokes of OP: ways back by a fair part of its usual span."""
    strokes, direction, extreme = 0, 1.0, float(u[0])
    for k, value in enumerate(u.tolist()):
        if direction * (value - extreme) > 0.0:
            extreme = value
        elif direction * (extreme - value) > _STROKE * span:
            strokes, direction, extreme = strokes + 1, -direction, value
            if strokes > most:
                return min(u.size, max(k, 5 * _LONGEST))
    return u.size


def _leads(u: Array, first: float) -> Array:
    """Leads of all samples at which a first slip in this direction can happen."""
    leads = first_leads(u, first)
    if leads.size > _MOST_STARTS:
        leads = leads[np.linspace(0, leads.size - 1, _MOST_STARTS).astype(int)]
    return leads


def _listed(op: Op, tables: ScanTables, step: float, span: float) -> _Beam:
    pairs = [(lead, first) for first in (1.0, -1.0) for lead in _leads(op.u, first)]
    ends = [
        (narrow, wide, 0.5 * ratio * (narrow + wide), 0.5 * ratio * (narrow + wide))
        for narrow, wide in pairwise(_BANDS)
        for ratio in _RATIOS
    ]
    starts = np.array(pairs * len(ends))
    regions = span * np.repeat(ends, len(pairs), axis=0)
    least = np.array(
        [max(4.0 * _LEAST * step, 1.2 * span * len(pairs) * len(_RATIOS) / _MOST), 1.0]
    )
    regions, of = slip_patterns(op, regions, starts, least, 1.0, _MOST)
    starts = starts[of]
    costs = one_step_scan(op, tables, _valves(regions, starts))
    top = np.argpartition(costs, min(_TOP, costs.size - 1), axis=None)[:_TOP]
    delay, j = np.unravel_index(top, costs.shape)
    found = _Beam(regions[j], starts[j], delay + 1, costs[delay, j].astype(np.float64))
    return _best(found, _BIN * span, _KEPT[0])


def _followed(
    op: Op, tables: ScanTables, beam: _Beam, step: float, span: float, stage: int
) -> _Beam:
    factors = _FACTORS if stage > 1 else np.ones(1)
    beam = beam.taken(np.repeat(np.arange(beam.delays.size), factors.size))
    regions = beam.regions.copy()
    regions[:, 2:] *= np.resize(factors, beam.delays.size)[:, None]
    least = np.array([_LEAST * step, 1.0])
    regions, of = slip_patterns(op, regions, beam.starts, least, 1.0, _MOST)
    starts, delays = beam.starts[of], beam.delays[of]
    costs = one_step_followed(op, tables, _valves(regions, starts), delays)
    return _best(_Beam(regions, starts, delays, costs), _BIN * span, _KEPT[stage])


def _valves(regions: Array, starts: Array) -> Array:
    """S, J, lead, first direction, ``(m, 4)``: the widest stick band slips as the region does."""
    jump = np.minimum(0.5 * (regions[:, 2] + regions[:, 3]), regions[:, 1])
    return np.column_stack([regions[:, 1], jump, starts])


def _best(found: _Beam, bin_: float, kept: int) -> _Beam:
    """The best ones, few to a stick band and dead time; best first."""
    ranked = found.taken(np.argsort(found.costs, kind="stable"))
    ranked = ranked.taken(np.flatnonzero(np.isfinite(ranked.costs)))
    number = np.floor(ranked.regions[:, 1] / bin_).astype(np.int64) * (_LONGEST + 1) + ranked.delays
    return ranked.taken(_first_of(number, _PER_BIN)[:kept])


def _first_of(number: Index, count: int) -> Index:
    """Indices of the first ``count`` of each number, in order."""
    order = np.argsort(number, kind="stable")
    ranked = number[order]
    start = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1]]))
    place = np.arange(number.size) - np.repeat(start, np.diff(np.append(start, number.size)))
    return np.sort(order[place < count])


def _tables(y: Array, good: Mask, delays: int) -> ScanTables:
    """PV's past projected out of it, and everything laid out by dead time."""
    n = y.size
    usable = good.copy()
    for i in range(1, _PAST + 1):
        usable[i:] &= good[:-i]
    usable[: delays + 2] = False
    weight = usable.astype(np.float64)
    past = [np.ones(n), *(np.roll(y, i) for i in range(1, _PAST + 1))]
    basis, _ = np.linalg.qr(np.stack(past, axis=1) * weight[:, None])
    target = y * weight
    rest = target - basis @ (basis.T @ target)
    plain = np.vstack([rest, basis.T, weight])
    padded = np.zeros((plain.shape[0], n + delays))
    padded[:, :n] = plain
    summed = np.cumsum(padded[:, ::-1], axis=1)[:, ::-1]
    late = np.minimum(np.arange(n)[:, None] + np.arange(1, delays + 1), n + delays - 1)
    parts = [*(one[late] for one in summed[:-1]), *(one[late] for one in padded[:-1])]
    table = np.hstack([*parts, summed[-1][late], padded[-1][late]]).astype(np.float32)
    return ScanTables(table, plain.shape[0] - 1, delays, float(rest @ rest))
