"""Local search from one start: valve and poles together, to the nearest minimum of the cost."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.special import ndtr, ndtri

from compiled import kernel
from estimator.algebra import cholesky, order_of
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.linear_fit import Design
from estimator.lane_costs import Judged, costs_of_stems
from estimator.lanes import tells
from estimator.processes.poles import (
    SHAPE_NUMBERS,
    Poles,
    Shape,
    coefficients_of,
    moved_poles,
)
from estimator.search.processes import spread_points
from estimator.valves.laws import LAWS

__all__ = [
    "Descent",
    "Found",
    "descend",
    "moved_valves",
    "refine_valve",
    "turned_points",
]

LEAST_BAND, WIDEST_BAND = 0.004, 1.1
"""Stick bands that are tried, as shares of OP's span."""
_WIDTHS = np.array([1.0, 2.0, 2.0, 3.0, 4.0])
"""First reach in log S, J / S, start / S and the logs of two time constants, relative."""
_LEARNED = 0.7
"""Share of the new covariance in that of the next round."""
_ENOUGH = 0.3
"""Nats of a turn below which it was the last: a third of what one parameter gains by chance."""
_RIDGE = 1e-16
_TIE = 1e-12
"""Relative gain below which two sums of squares are the same: rounding decides nothing."""


@dataclass(frozen=True, slots=True)
class Found:
    """A valve with its process and the sum of squares it leaves under one noise model."""

    squares: float
    valve: Valve
    poles: Poles
    dead_time: int


@cache
def turned_points(count: int, dimensions: int, turn: int) -> Array:
    """Even points of a normal distribution, ``(count, dimensions)``; another set every ``turn``."""
    shift = spread_points(64, dimensions)[(17 * turn) % 64]
    points = spread_points(count + 1, dimensions)[1:]
    shares = np.mod(ndtr(points) + ndtr(shift), 1.0)
    found: Array = ndtri(np.clip(shares, 1e-3, 1.0 - 1e-3))
    return found


@kernel
def moved_valves(valve: Array, steps: Array) -> Array:
    """Valves ``(m, 3)`` from one by steps in log S, J / S and start / S."""
    out = np.empty((steps.shape[0], 3))
    for j in range(steps.shape[0]):
        band = min(max(valve[0] * math.exp(steps[j, 0]), LEAST_BAND), WIDEST_BAND)
        ratio = min(max(valve[1] / valve[0] + steps[j, 1], 0.0), 1.0)
        out[j, 0], out[j, 1], out[j, 2] = band, ratio * band, valve[2] + steps[j, 2] * band
    return out


@kernel
def _candidates(
    points: Array,
    middle: Array,
    root: Array,
    best: Array,
    valve: Array,
    shape: int,
    start: Array,
) -> tuple[Array, Array, Array]:
    """Steps ``(m, 5)`` around the ``middle``, the best so far first; their valves and processes."""
    count, wide = points.shape
    table, poles = np.empty((count, wide)), np.zeros((count, 3))
    for j in range(count):
        for i in range(wide):
            total = middle[i]
            for c in range(i + 1):
                total += root[i, c] * points[j, c]
            table[j, i] = total if j > 0 else best[i]
        poles[j, :2] = table[j, 3:]
    return (
        table,
        moved_valves(valve, table),
        coefficients_of(shape, moved_poles(shape, start, poles)),
    )


@kernel
def _learn(
    stems: Array,
    processes: Array,
    judged: Judged,
    dead_times: tuple[int, int],
    works: tuple[int, float],
    table: Array,
    middle: Array,
    root: Array,
) -> tuple[float, int, int, Array, Array]:
    """Least cost, its lane and dead time; middle and root of the next round.

    ``dead_times`` are the shortest one and how many; lanes whose stem does not work like a valve
    (least reversals and least spread, ``works``) come last.
    """
    costs = costs_of_stems(stems, processes, judged, dead_times[0], dead_times[1])
    told = tells(stems, works[0], works[1])
    lanes, wide = table.shape
    of_lane = np.full(lanes, np.inf)
    for j in range(lanes):
        if told[j]:
            of_lane[j] = costs[:, j].min()
    chosen = lanes // 4
    order = order_of(of_lane)[:chosen]
    weight = np.log(chosen + 0.5) - np.log(np.arange(1.0, chosen + 1.0))
    weight /= weight.sum()
    moved = middle.copy()
    covariance = np.zeros((wide, wide))
    for i in range(wide):
        for c in range(wide):
            for d in range(min(i, c) + 1):
                covariance[i, c] += (1.0 - _LEARNED) * root[i, d] * root[c, d]
        covariance[i, i] += _RIDGE
    for r in range(chosen):
        for i in range(wide):
            step = table[order[r], i] - middle[i]
            moved[i] += weight[r] * step
            for c in range(wide):
                other = table[order[r], c] - middle[c]
                covariance[i, c] += _LEARNED * weight[r] * step * other
    top = order[0]
    late = int(costs[:, top].argmin())
    return of_lane[top], top, late, moved, cholesky(covariance)


def descend(
    case: Case,
    design: Design,
    start: Found,
    width: float,
    rounds: int,
    lanes: int,
    stride: int = 1,
) -> Found:
    """Valve and poles refined together under one noise model; see `Descent`."""
    way = Descent(case, design, start, width, lanes, stride)
    way.go_on(rounds)
    return way.found


class Descent:
    """Valve and poles on their way down one valley, under one noise model.

    Samples of a normal distribution that learns the valley it lies in: its covariance becomes that
    of the best samples around the mean before (rank-mu update of CMA-ES; Hansen, The CMA evolution
    strategy: a tutorial, 2016). Stick band and time constants trade against each other along curved
    valleys, which steps in single parameters do not follow.
    """

    def __init__(
        self, case: Case, design: Design, start: Found, width: float, lanes: int, stride: int = 1
    ) -> None:
        origin = start.poles
        if origin.shape is Shape.LAGS:
            slow = max(origin.slow, 0.2)
            origin = replace(origin, slow=slow, fast=origin.fast or max(0.15, 0.3 * slow))
        elif origin.shape is Shape.INTEGRATING:
            origin = replace(origin, fast=origin.fast or 0.5)
        self.case = case
        self.judged = design.judged if stride == 1 else design.judged_every(stride)
        self.origin, self.law = origin, start.valve.law
        self.valve = np.array(start.valve.numbers)
        self.lanes = lanes
        self.turn = 0
        self.middle, self.root = np.zeros(5), np.diag(width * _WIDTHS)
        self.squares, self.best, self.late = np.inf, np.zeros(5), start.dead_time

    def go_on(self, rounds: int) -> None:
        """So many rounds more, unless no sample works like a valve."""
        case = self.case
        shape = SHAPE_NUMBERS[self.origin.shape]
        start = np.array([self.origin.slow, self.origin.fast, self.origin.third])
        law, longest, works = LAWS[self.law], case.max_dead_time, case.works
        for _ in range(rounds):
            points = turned_points(self.lanes, 5, self.turn)
            table, valves, processes = _candidates(
                points, self.middle, self.root, self.best, self.valve, shape, start
            )
            stems = law(case.rows.u, valves)
            shortest = max(case.rows.soonest, self.late - 1)
            count = min(3, longest + 1 - shortest)
            least, top, late, middle, root = _learn(
                stems,
                processes,
                self.judged,
                (shortest, count),
                works,
                table,
                self.middle,
                self.root,
            )
            if not np.isfinite(least):
                return
            if least < self.squares * (1.0 - _TIE):
                self.squares, self.best, self.late = least, table[top].copy(), shortest + late
            self.middle, self.root = middle, root
            self.turn += 1

    @property
    def found(self) -> Found:
        """The best of all rounds."""
        best = self.best
        band, jump, first = (float(v) for v in moved_valves(self.valve, best[None])[0])
        row = self.origin.moved(np.array([[best[3], best[4], 0.0]]))[0]
        valve = Valve(band, jump, first, self.law)
        return Found(self.squares, valve, self.origin.of_row(row), self.late)


def refine_valve(
    case: Case,
    start: Hypothesis,
    width: float = 0.05,
    law: str | None = None,
    rival: Hypothesis | None = None,
) -> Hypothesis:
    """The hypothesis with valve and poles refined together, its noise model in turn.

    Under another ``law`` than its own it is that law's hypothesis, likelier or not. It is given up
    after a turn that leaves it further behind a ``rival`` than the turn has gained: the next gains
    less.
    """
    assert start.valve is not None
    searching = case.settings.searching
    best = start
    if law is not None and law != start.valve.law:
        valve = replace(start.valve, law=law)
        best = case.fit(valve, start.poles, start.dead_time, start.nuisances, start.taps)
    for _ in range(searching.turns):
        assert best.valve is not None
        design = case.design(best.nuisances, best.taps, best.stem, best.poles, best.dead_time)
        at = Found(np.inf, best.valve, best.poles, best.dead_time)
        end = descend(case, design, at, width, searching.rounds, searching.lanes)
        found = case.fit(end.valve, end.poles, end.dead_time, best.nuisances, best.taps)
        gained = found.likelihood - best.likelihood
        if gained > 0.0:
            best = found
        if gained < _ENOUGH:
            break
        if rival is not None and best.likelihood + gained < rival.likelihood:
            break
        width *= 0.5
    return best
