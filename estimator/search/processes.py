"""The process behind a known stem: every start at once, then its poles closer and closer."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.special import ndtri

from compiled import kernel
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.nuisances import Nuisance
from estimator.lane_costs import Judged, costs_of_processes
from estimator.processes.poles import (
    SHAPE_NUMBERS,
    STARTS,
    Poles,
    Shape,
    coefficients,
    coefficients_of,
    moved_poles,
    pole_prices,
)

__all__ = [
    "POLE_LANES",
    "POLE_NARROWER",
    "POLE_REACH",
    "POLE_ROUNDS",
    "polish",
    "settle",
    "spread_points",
]

_LAGS, _INTEGRATING = SHAPE_NUMBERS[Shape.LAGS], SHAPE_NUMBERS[Shape.INTEGRATING]
_BETTER = 1e-6
"""Nats by which a candidate must be better: rounding decides nothing."""


@cache
def spread_points(count: int, dimensions: int) -> Array:
    """Points ``(count, dimensions)`` that fill a normal distribution evenly, the first its centre.

    A Kronecker sequence of the generalised golden ratio, through the normal quantile: the same on
    every machine, and no seed.
    """
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    shares = np.mod(0.5 + np.arange(1, count)[:, None] * steps, 1.0)
    points = np.vstack([np.zeros(dimensions), ndtri(np.clip(shares, 1e-3, 1.0 - 1e-3))])
    points.flags.writeable = False
    return points


def polish(
    case: Case,
    valve: Valve | None,
    start: Hypothesis | tuple[Poles, int],
    nuisances: tuple[Nuisance, ...],
    taps: Array,
    *,
    passes: int = 2,
    wide: bool = True,
) -> Hypothesis:
    """The best process, noise and linear part for one valve.

    ``wide`` tries all starting processes, otherwise only those near the given one. Noise and
    process are fitted in turn until the likelihood no longer rises.
    """
    poles, dead_time = (start.poles, start.dead_time) if isinstance(start, Hypothesis) else start
    stem = case.stem(valve)
    best: Hypothesis | None = None
    for turn in range(passes):
        if wide and turn == 0:
            poles, dead_time = _best_start(case, stem, poles, dead_time, nuisances, taps)
        poles, dead_time = refine_poles(case, stem, poles, dead_time, nuisances, taps)
        found = case.fit(valve, poles, dead_time, nuisances, taps, stem=stem)
        if best is not None and found.likelihood <= best.likelihood + _BETTER:
            break
        best, taps = found, found.taps
    assert best is not None
    return best


def settle(case: Case, start: Hypothesis, passes: int = 2) -> Hypothesis:
    """The hypothesis with its poles freed further (a third one if it pays), valve held."""
    best = start
    for turn in range(passes):
        found = polish(case, best.valve, best, best.nuisances, best.taps, passes=1, wide=False)
        if turn == 0 and best.poles.third == 0.0:
            seeded = replace(best.poles, third=max(0.3, 0.3 * _shortest(best.poles)))
            third = polish(
                case,
                best.valve,
                (seeded, max(case.rows.soonest, best.dead_time - 1)),
                best.nuisances,
                best.taps,
                passes=1,
                wide=False,
            )
            found = max(found, third, key=lambda one: one.likelihood)
        if found.likelihood <= best.likelihood + 1e-3:
            break
        best = found
    return best


def _shortest(poles: Poles) -> float:
    if poles.shape is Shape.SWINGING:
        return poles.slow / 6.0
    return min([t for t in (poles.slow, poles.fast) if t > 0.0], default=1.0)


def _best_start(
    case: Case,
    stem: Array,
    poles: Poles,
    dead_time: int,
    nuisances: tuple[Nuisance, ...],
    taps: Array,
) -> tuple[Poles, int]:
    """The best of all starting processes and the given one, with its dead time."""
    best = (np.inf, poles, dead_time)
    for shape, (group, table, processes) in _starts().items():
        design = case.design(nuisances, taps, stem, replace(poles, shape=shape), dead_time)
        soonest = case.rows.soonest
        costs = design.through(stem, processes, soonest, case.max_dead_time + 1 - soonest)
        rows = case.rows.count, case.rows.floor
        worth, lane, late = _least_worth(costs, SHAPE_NUMBERS[shape], table, rows)
        if worth < best[0] - _BETTER:
            best = (worth, group[lane], soonest + late)
    return best[1], best[2]


@cache
def _starts() -> dict[Shape, tuple[tuple[Poles, ...], Array, Array]]:
    """Starting processes of each shape: their numbers ``(m, 3)`` and coefficients ``(4, m)``."""
    found = {}
    for shape in Shape:
        group = tuple(p for p in STARTS if p.shape is shape)
        table = np.array([[p.slow, p.fast, p.third] for p in group])
        found[shape] = group, table, coefficients(shape, table)
    return found


POLE_REACH, POLE_NARROWER = 0.6, 0.4
"""First reach of a refinement in logs of time constants, and its factor from round to round."""
POLE_LANES, POLE_ROUNDS = 16, 3
"""Processes of a round, and rounds."""


def refine_poles(
    case: Case,
    stem: Array,
    poles: Poles,
    dead_time: int,
    nuisances: tuple[Nuisance, ...],
    taps: Array,
) -> tuple[Poles, int]:
    """Poles and dead time of the least cost near the given ones, the noise model held."""
    design = case.design(nuisances, taps, stem, poles, dead_time)
    row, late = _refined(
        stem,
        design.judged,
        SHAPE_NUMBERS[poles.shape],
        np.array([poles.slow, poles.fast, poles.third]),
        (dead_time, case.rows.soonest, case.max_dead_time),
        spread_points(POLE_LANES, 3),
        (case.rows.count, case.rows.floor),
    )
    return poles.of_row(row), late


@kernel
def _refined(
    stem: Array,
    judged: Judged,
    shape: int,
    start: Array,
    dead_times: tuple[int, int, int],
    points: Array,
    rows: tuple[float, float],
) -> tuple[Array, int]:
    """Time constants ``(3,)`` and dead time of `refine_poles`.

    ``dead_times`` are the given, the least and the longest one, ``rows`` the number of judged rows
    and the least variance.
    """
    late, soonest, longest = dead_times
    row, reach, best = start, POLE_REACH, np.inf
    for _ in range(POLE_ROUNDS):
        table = moved_poles(shape, row, reach * points)
        if shape == _LAGS and row[0] == 0.0:
            table[-4:, 0] = np.array([0.2, 0.4, 0.7, 1.2])
        elif shape == _LAGS and row[1] == 0.0:
            # a second lag of any size where there was none
            table[-8:] = row
            table[-8:, 1] = np.maximum(0.15, np.linspace(0.05, 1.0, 8) * row[0])
        elif shape == _INTEGRATING and row[1] == 0.0:
            table[-4:, 1] = np.array([0.3, 1.0, 3.0, 8.0])
        shortest = max(soonest, late - 1)
        count = min(3, longest + 1 - shortest)
        processes = coefficients_of(shape, table)
        costs = costs_of_processes(stem, processes, judged, shortest, count)
        least, lane, at = _least_worth(costs, shape, table, rows)
        if least < best - _BETTER:
            best, row, late = least, table[lane].copy(), shortest + at
        reach *= POLE_NARROWER
    return row, late


@kernel
def _least_worth(
    costs: Array, shape: int, table: Array, rows: tuple[float, float]
) -> tuple[float, int, int]:
    """Least of minus the log-likelihood and the poles' price, in nats; its lane and dead time."""
    count, floor = rows
    least, lane, late = np.inf, 0, 0
    price = pole_prices(shape, table, count)
    for d in range(costs.shape[0]):
        for j in range(table.shape[0]):
            worth = 0.5 * count * math.log(max(costs[d, j], 0.0) / count + floor) + price[j]
            if worth < least:
                least, lane, late = worth, j, d
    return least, lane, late
