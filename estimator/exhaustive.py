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

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Index, Mask, complete
from estimator._listing import OneStepRows, Sets, list_sets, list_sets_at, sets_of
from estimator._past import past_of, slip_table, unexplained
from estimator._slips import Op, first_slips, op_of, step_of, usual_span
from estimator.candidate import Candidate
from estimator.structures import COARSE

__all__ = ["one_step_seeds"]

_PAST = 3
"""Past values of PV in the regression; enough to rank, the orders are chosen later."""

_LONGEST = 20
_BANDS = (0.02, 0.06, 0.12, 0.25, 0.5, 1.05)
"""Ends of the stick bands that are listed, as shares of the usual span of OP."""
_FACTORS = np.array([0.6, 1.0, 1.5])
_LEAST = 0.04
"""Sets of slips are told apart down to this share of OP's step per sample."""
_STROKE = 0.3
"""A stroke as a share of the usual span of OP."""
_LISTINGS = (6, (0.12, 0.4)), (12, (0.2, 0.65))
"""How many strokes are listed first, and the slip jumps of the listing as shares of the middle of a
stick band: once each way, because few strokes are ambiguous and many are listed coarsely."""
_OTHER, _DECIDED = 0.02, 12.0
"""A stick band is another one from this share on; how much less likely the likeliest of these must
be (in the logarithm) for the first listing to be enough."""
_ZERO = 1e-9
_GROWTH = 1.6
_KEPT = (300, 150, 80, 50, 30)
_BIN, _PER_BIN = 0.04, 4
_MOST = 40_000
_MOST_STARTS = 48


class _Beam(NamedTuple):
    """Valves that are followed, best first: ends of S and J, lead and first direction ``(m, 6)``,
    dead times and costs ``(m,)``."""

    regions: Array
    delays: Index
    costs: Array

    @property
    def valves(self) -> Array:
        """S, J, lead, first direction: the widest stick band slips as the region does."""
        low, high = self.regions[:, 2], self.regions[:, 3]
        jump = np.minimum(0.5 * (low + high), self.regions[:, 1])
        return np.column_stack([self.regions[:, 1], jump, self.regions[:, 4:]])


def one_step_seeds(op: Op, y: Array, good: Mask, count: int) -> tuple[Candidate, ...]:
    """The best valves, apart from each other in stick band or dead time: ``count`` of each listing.

    ``op`` and ``y`` are scaled OP and PV, shape ``(n,)``; ``good`` marks the samples that count.
    The candidates' process is none in particular, but for the dead time.
    """
    step = step_of(op.u)
    span = usual_span(op.u)
    listings: dict[int, tuple[float, ...]] = {}
    for strokes, some in _LISTINGS:
        length = _first_length(op.u, span, strokes)
        listings[length] = (*listings.get(length, ()), *some)
    found: list[Candidate] = []
    apart = 0.4 * step
    for length, ratios in listings.items():
        if _decided(found, y.size):
            break
        beam = _grown(op, y, good, length, ratios, step, span)
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


def _decided(found: list[Candidate], count: int) -> bool:
    """Whether no valve with another stick band comes near the best one, so that no more is listed.

    ``found`` are those of the first listing, best first, judged over ``count`` samples.
    """
    others = [one.cost for one in found if abs(one.band - found[0].band) > _OTHER * one.band]
    if not others:
        return False
    # a sum that is zero but for rounding may come out below it
    best, other = max(found[0].cost, _ZERO), max(min(others), _ZERO)
    return 0.5 * count * math.log(other / best) > _DECIDED


def _grown(
    op: Op,
    y: Array,
    good: Mask,
    length: int,
    ratios: tuple[float, ...],
    step: float,
    span: float,
) -> _Beam:
    """The valves that are left at the end of the window, first listed in its first samples."""
    n = op.u.size
    delays = min(_LONGEST, n // 12)
    part = op_of(op.u[:length])
    beam = _listed(part, _rows(y[:length], good[:length], delays), ratios, step, span)
    stage = 0
    while length < n:
        length, stage = min(n, int(length * _GROWTH) + 1), min(stage + 1, len(_KEPT) - 1)
        part = op_of(op.u[:length])
        rows = _rows(y[:length], good[:length], delays)
        beam = _followed(part, rows, beam, step, span, stage)
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
    leads = first_slips(u, first).leads
    if leads.size > _MOST_STARTS:
        leads = leads[np.linspace(0, leads.size - 1, _MOST_STARTS).astype(int)]
    return leads


def _listed(
    op: Op, rows: OneStepRows, ratios: tuple[float, ...], step: float, span: float
) -> _Beam:
    pairs = [(lead, first) for first in (1.0, -1.0) for lead in _leads(op.u, first)]
    ends = [
        (narrow, wide, 0.5 * ratio * (narrow + wide), 0.5 * ratio * (narrow + wide))
        for narrow, wide in pairwise(_BANDS)
        for ratio in ratios
    ]
    starts = np.array(pairs * len(ends))
    regions = span * np.repeat(ends, len(pairs), axis=0)
    coarsest = 1.2 * span * len(pairs) * len(ratios) / _MOST
    least = np.array([max(8.0 * _LEAST * step, coarsest), 1.0])
    sets = sets_of(_BIN * span, _BANDS[-1] * span, rows.delays, _PER_BIN)
    list_sets(op, rows, regions, starts, least, _MOST, sets)
    return _best(sets, _KEPT[0])


def _followed(
    op: Op, rows: OneStepRows, beam: _Beam, step: float, span: float, stage: int
) -> _Beam:
    factors = _FACTORS if stage > 1 else np.ones(1)
    again = np.repeat(np.arange(beam.delays.size), factors.size)
    regions = beam.regions[again]
    regions[:, 2:4] *= np.resize(factors, again.size)[:, None]
    starts = np.ascontiguousarray(regions[:, 4:])
    regions = np.ascontiguousarray(regions[:, :4])
    least = np.array([_LEAST * step, 1.0])
    sets = sets_of(_BIN * span, _BANDS[-1] * span, rows.delays, _PER_BIN)
    list_sets_at(op, rows, beam.delays[again], regions, starts, least, _MOST, sets)
    return _best(sets, _KEPT[stage])


def _best(sets: Sets, kept: int) -> _Beam:
    """The best of all bins, best first."""
    order = np.argsort(sets.cost, axis=None, kind="stable")[:kept]
    bin_, delay, place = np.unravel_index(order, sets.cost.shape)
    costs = sets.cost[bin_, delay, place]
    found = np.isfinite(costs)
    return _Beam(sets.region[bin_, delay, place][found], delay[found] + 1, costs[found])


def _rows(y: Array, good: Mask, delays: int) -> OneStepRows:
    """PV's past projected out of it, and everything summed from each sample on."""
    n = y.size
    usable = complete(good, _PAST)
    usable[: delays + 2] = False
    weight = usable.astype(np.float64)
    rows = unexplained(y, weight, past_of(y, _PAST, weight))
    table = slip_table(rows, weight, 0, 1, n + delays)
    width = 2 * rows.shape[0]
    return OneStepRows(
        table[:, :width].ravel(),
        np.ascontiguousarray(table[:, width:].T),
        rows.shape[0],
        delays,
        float(rows[0] @ rows[0]),
    )
