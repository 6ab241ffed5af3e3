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
    Seed,
    Steps,
    diverse,
    lattice,
    stem_of,
    valve_grid,
)

__all__ = ["ArxFound", "arx_promises", "arx_search"]

VALVE_PARAMETERS = 3
_PROMISE = 4.0
_SEED_ORDERS = 3, 2
_FINALISTS = 3
_SCAN_SEEDS = 5
_PASSES = 6
_ROUNDS = 3
_NEAR = Steps(band=0.008, ratio=0.3, start=0.08)
"""Half-widths of the first zoom around a seed: the spacing of the grid it comes from."""


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


def arx_search(
    u: Array, y: Array, good: Mask, best: Candidate, seeds: tuple[Seed, ...]
) -> ArxFound:
    """Valve and orders that predict PV best; ``best`` is that of the simulation error.

    The best valves of an exhaustive grid over valve and dead time are refined with orders fixed;
    the finalists choose their own orders, are refined again, and the lowest BIC wins.
    """
    rough: list[tuple[Candidate, ArxRegression]] = []
    regressions: dict[int, ArxRegression] = {}
    for seed in (*(seed.like(best) for seed in seeds), best):
        delay = max(1, seed.dead_time)
        if delay not in regressions:
            regressions[delay] = ArxRegression(y, good, ArxOrders(*_SEED_ORDERS, delay))
        regression = regressions[delay]
        started = replace(seed.anchored(u), cost=np.inf)
        rough.append((_zoomed(u, regression, started, _NEAR, _PASSES), regression))
    # costs of regressions with other dead times count other rows: compared per row
    rough.sort(key=lambda pair: pair[0].cost / pair[1].count)
    found: list[ArxFound] = []
    for candidate, _ in rough[:_FINALISTS]:
        found.append(_settled(u, y, good, candidate))
    return min(found, key=lambda one: one.bic / one.regression.count)


def _settled(u: Array, y: Array, good: Mask, best: Candidate) -> ArxFound:
    """Orders for the valve and the valve for these orders, in turn, until both agree."""
    ranked = select_orders(y, good, best.stem(u))
    for _ in range(_ROUNDS):
        orders = ranked[0]
        regression = ArxRegression(y, good, orders)
        started = replace(best.anchored(u), cost=np.inf)
        best = _zoomed(u, regression, started, _NEAR, _PASSES)
        for scan in SCANS[1:]:
            best = _scanned(u, regression, best, scan)
        ranked = select_orders(y, good, best.stem(u))
        chosen = ranked[0]
        if (chosen.na, chosen.nb, chosen.dead_time) == (orders.na, orders.nb, orders.dead_time):
            break
    return ArxFound(best, regression, tuple(ranked))


def _scanned(u: Array, regression: ArxRegression, best: Candidate, scan: Scan) -> Candidate:
    band, ratio, start = lattice(best, scan)
    stem, moves = stem_of(u, band, ratio, start)
    cost, _ = regression.costs(stem)
    cost[moves < MIN_MOVES] = np.inf
    found = [best]
    for i in diverse(cost, band, 0.05 * scan.band * best.band, _SCAN_SEEDS):
        seed = replace(
            best,
            cost=float(cost[i]),
            band=float(band[i]),
            ratio=float(ratio[i]),
            start=float(start[i]),
        )
        found.append(_zoomed(u, regression, seed, scan.steps(best.band), SCAN_PASSES))
    return min(found, key=lambda candidate: candidate.cost)


def _zoomed(
    u: Array, regression: ArxRegression, best: Candidate, steps: Steps, passes: int
) -> Candidate:
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
    return best
