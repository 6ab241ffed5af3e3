"""The search for the valve under the one-step-ahead criterion, with its orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator._kernels import Array, Mask
from estimator.arx import ArxOrders, ArxRegression, select_orders
from estimator.coarse import coarse_valves
from estimator.search import MIN_MOVES, Candidate, Steps, stem_of, valve_grid

__all__ = ["arx_search"]

_SEEDS = 5
_FINALISTS = 2
_EARLY_PASSES = 4
_LATE_PASSES = 8
_ROUNDS = 3
_SCANS = ((0.3, 0.5, 1.0), (0.08, 0.25, 0.3), (0.02, 0.1, 0.1))
_SCAN_PASSES = 6
_APART = 0.04


def arx_search(
    u: Array, y: Array, good: Mask, seeds: tuple[Candidate, ...]
) -> tuple[Candidate, ArxRegression, list[ArxOrders]]:
    """Valve and orders that predict PV best; ``seeds`` are valves to start from, at least one.

    Orders are chosen for the best valve so far and the valve for these orders, in turn, until both
    agree. Returns the valve, the regression it was found with, and all orders, best first.
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
                for i in _diverse(cost, band, _APART)
            ]
        best = _refined(u, regression, started)
        ranked = select_orders(y, good, best.stem(u))
        chosen = ranked[0]
        if (chosen.na, chosen.nb, chosen.dead_time) == (orders.na, orders.nb, orders.dead_time):
            break
    return best, regression, ranked


def _diverse(cost: Array, band: Array, apart: float) -> list[int]:
    """Indices of the best nodes whose stick bands are apart."""
    found: list[int] = []
    for i in np.argsort(cost, kind="stable"):
        if all(abs(band[i] - band[j]) > apart for j in found):
            found.append(int(i))
            if len(found) == _SEEDS:
                break
    return found


def _refined(u: Array, regression: ArxRegression, seeds: list[Candidate]) -> Candidate:
    alive = [_zoomed(u, regression, seed, Steps(), _EARLY_PASSES) for seed in seeds]
    alive.sort(key=lambda pair: pair[0].cost)
    ended = [
        _zoomed(u, regression, seed, steps, _LATE_PASSES)[0] for seed, steps in alive[:_FINALISTS]
    ]
    best = min(ended, key=lambda candidate: candidate.cost)
    for reaches in _SCANS:
        best = _scanned(u, regression, best, *reaches)
    return best


def _scanned(
    u: Array,
    regression: ArxRegression,
    best: Candidate,
    reach: float,
    ratio_reach: float,
    start_reach: float,
) -> Candidate:
    """A fine lattice around ``best``: the likelihood of a clean window is a field of narrow spikes.

    A slip that is one sample off costs much, so a zoom alone ends on a spike near the right one.
    """
    grids = np.meshgrid(
        best.band * (1.0 + reach * np.linspace(-1.0, 1.0, 33)),
        np.unique(np.clip(best.ratio + ratio_reach * np.linspace(-1.0, 1.0, 9), 0.0, 1.0)),
        np.unique(np.clip(best.start + start_reach * np.linspace(-1.0, 1.0, 9), -1.0, 1.0)),
        indexing="ij",
    )
    band, ratio, start = (np.ascontiguousarray(grid.ravel()) for grid in grids)
    stem, moves = stem_of(u, band, ratio, start)
    cost, _ = regression.costs(stem)
    cost[moves < MIN_MOVES] = np.inf
    steps = Steps(band=best.band * reach / 10.0, ratio=ratio_reach / 5.0, start=start_reach / 6.0)
    found = [best]
    for i in _diverse(cost, band, 0.05 * reach * best.band):
        seed = replace(
            best,
            cost=float(cost[i]),
            band=float(band[i]),
            ratio=float(ratio[i]),
            start=float(start[i]),
        )
        found.append(_zoomed(u, regression, seed, steps, _SCAN_PASSES)[0])
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
