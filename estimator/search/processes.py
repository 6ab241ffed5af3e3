"""The process behind a known stem: every start at once, then its poles closer and closer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.nuisances import Nuisance
from estimator.processes.poles import STARTS, Poles, Shape, coefficients

__all__ = [
    "POLE_LANES",
    "POLE_NARROWER",
    "POLE_REACH",
    "POLE_ROUNDS",
    "polish",
    "settle",
    "spread_points",
]

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
                (seeded, max(0, best.dead_time - 1)),
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
    for shape, group in _starts().items():
        design = case.design(nuisances, taps, stem, replace(poles, shape=shape), dead_time)
        table = np.array([[p.slow, p.fast, p.third] for p in group])
        stems = np.repeat(stem[:, None], len(group), axis=1)
        costs = design.paired(stems, coefficients(shape, table), 0, case.max_dead_time + 1)
        worth = case.worth(costs) + case.pole_prices(shape, table)
        late, lane = np.unravel_index(int(worth.argmin()), worth.shape)
        if worth[late, lane] < best[0] - _BETTER:
            best = (float(worth[late, lane]), group[int(lane)], int(late))
    return best[1], best[2]


@cache
def _starts() -> dict[Shape, tuple[Poles, ...]]:
    return {shape: tuple(p for p in STARTS if p.shape is shape) for shape in Shape}


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
    stems = np.repeat(stem[:, None], POLE_LANES, axis=1)
    points = spread_points(POLE_LANES, 3)
    reach, best = POLE_REACH, np.inf
    for _ in range(POLE_ROUNDS):
        table = poles.moved(reach * points)
        if poles.shape is Shape.LAGS and poles.slow == 0.0:
            table[-4:, 0] = 0.2, 0.4, 0.7, 1.2
        elif poles.shape is Shape.LAGS and poles.fast == 0.0:
            # a second lag of any size where there was none
            table[-8:] = poles.slow, 0.0, poles.third
            table[-8:, 1] = np.maximum(0.15, np.linspace(0.05, 1.0, 8) * poles.slow)
        elif poles.integrating and poles.fast == 0.0:
            table[-4:, 1] = 0.3, 1.0, 3.0, 8.0
        shortest = max(0, dead_time - 1)
        count = min(3, case.max_dead_time + 1 - shortest)
        costs = design.paired(stems, coefficients(poles.shape, table), shortest, count)
        worth = case.worth(costs) + case.pole_prices(poles.shape, table)
        late, lane = np.unravel_index(int(worth.argmin()), worth.shape)
        if worth[late, lane] < best - _BETTER:
            best = float(worth[late, lane])
            poles, dead_time = poles.of_row(table[lane]), shortest + int(late)
        reach *= POLE_NARROWER
    return poles, dead_time
