"""The search for the valve under the one-step-ahead criterion, with its orders."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator._kernels import Array, Mask
from estimator.arx import ArxOrders, ArxRegression, select_orders
from estimator.coarse import coarse_valves
from estimator.search import (
    MIN_MOVES,
    SCAN_PASSES,
    SCANS,
    Candidate,
    Scan,
    Steps,
    diverse,
    lattice,
    stem_of,
    valve_grid,
)

__all__ = ["ArxFound", "arx_promises", "arx_search"]

VALVE_PARAMETERS = 3
_PROMISE = 4.0
_SEEDS = 5
_FINALISTS = 2
_EARLY_PASSES = 4
_LATE_PASSES = 8
_ROUNDS = 3
_APART = 0.04


@dataclass(frozen=True, slots=True)
class ArxFound:
    """What the search found: the valve, the regression of its orders, all orders, best first."""

    best: Candidate
    regression: ArxRegression
    ranked: tuple[ArxOrders, ...]

    @property
    def bic(self) -> float:
        """BIC of its one-step errors, the valve's three parameters counted."""
        count = self.regression.count
        free = self.regression.orders.na + self.regression.orders.nb + 2 + VALVE_PARAMETERS
        return count * math.log(self.best.cost / count) + free * math.log(count)


def arx_promises(u: Array, y: Array, good: Mask, healthy: ArxOrders) -> bool:
    """Whether any valve of the coarse grid predicts PV better than a healthy valve does."""
    regression = ArxRegression(y, good, healthy)
    stem, moves = stem_of(u, *coarse_valves())
    moving = moves >= MIN_MOVES
    if not moving.any():
        return False
    cost, _ = regression.costs(np.ascontiguousarray(stem[:, moving]))
    straight, _ = regression.costs(np.ascontiguousarray(u[:, None]))
    ratio = 0.5 * regression.count * math.log(float(straight[0]) / float(cost.min()))
    return ratio > _PROMISE


def arx_search(u: Array, y: Array, good: Mask, seeds: tuple[Candidate, ...]) -> ArxFound:
    """Valve and orders that predict PV best; ``seeds`` are valves to start from, at least one.

    Orders are chosen for the best valve so far and the valve for these orders, in turn, until both
    agree.
    """
    coarse = coarse_valves()
    stem, moves = stem_of(u, *coarse)
    moving = moves >= MIN_MOVES
    band, ratio, start = (axis[moving] for axis in coarse)
    stem = np.ascontiguousarray(stem[:, moving])
    best = seeds[0]
    ranked = select_orders(y, good, best.stem(u))
    for _ in range(_ROUNDS):
        orders = ranked[0]
        regression = ArxRegression(y, good, orders)
        started = [replace(seed, cost=np.inf) for seed in (best, *seeds)]
        if band.size:
            cost, _ = regression.costs(stem)
            started += [
                replace(best, cost=float("inf"), band=band[i], ratio=ratio[i], start=start[i])
                for i in diverse(cost, band, _APART, _SEEDS)
            ]
        best = _refined(u, regression, started)
        ranked = select_orders(y, good, best.stem(u))
        chosen = ranked[0]
        if (chosen.na, chosen.nb, chosen.dead_time) == (orders.na, orders.nb, orders.dead_time):
            break
    return ArxFound(best, regression, tuple(ranked))


def _refined(u: Array, regression: ArxRegression, seeds: list[Candidate]) -> Candidate:
    alive = [_zoomed(u, regression, seed, Steps(), _EARLY_PASSES) for seed in seeds]
    alive.sort(key=lambda pair: pair[0].cost)
    ended = [
        _zoomed(u, regression, seed, steps, _LATE_PASSES)[0] for seed, steps in alive[:_FINALISTS]
    ]
    best = min(ended, key=lambda candidate: candidate.cost)
    for scan in SCANS:
        best = _scanned(u, regression, best, scan)
    return best


def _scanned(u: Array, regression: ArxRegression, best: Candidate, scan: Scan) -> Candidate:
    band, ratio, start = lattice(best, scan)
    stem, moves = stem_of(u, band, ratio, start)
    cost, _ = regression.costs(stem)
    cost[moves < MIN_MOVES] = np.inf
    found = [best]
    for i in diverse(cost, band, 0.05 * scan.band * best.band, _SEEDS):
        seed = replace(
            best,
            cost=float(cost[i]),
            band=float(band[i]),
            ratio=float(ratio[i]),
            start=float(start[i]),
        )
        found.append(_zoomed(u, regression, seed, scan.steps(best.band), SCAN_PASSES)[0])
    return min(found, key=lambda candidate: candidate.cost)


def _zoomed(
    u: Array, regression: ArxRegression, best: Candidate, steps: Steps, passes: int
) -> tuple[Candidate, Steps]:
    for _ in range(passes):
        band, ratio, start = valve_grid(best, steps)
        stem, moves = stem_of(u, band, ratio, start)
        cost, _ = regression.costs(stem)
        cost[moves < MIN_MOVES] = np.inf
        i = int(cost.argmin())
        if cost[i] < best.cost:
            best = replace(
                best,
                cost=float(cost[i]),
                band=float(band[i]),
                ratio=float(ratio[i]),
                start=float(start[i]),
            )
        steps = steps.narrower()
    return best, steps
