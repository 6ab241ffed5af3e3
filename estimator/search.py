"""The search for the valve: exhaustive and coarse first, then refined around the best cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from estimator._kernels import Array, stems
from estimator.regression import Regression
from estimator.structures import COARSE, Structure

__all__ = ["Candidate", "healthy_search", "stem_of", "valve_search"]

_LAGS = (0, 1, 2, 3, 5, 8, 12, 18)
_BANDS = (
    *(0.01, 0.02, 0.03, 0.045, 0.065, 0.09, 0.12, 0.16, 0.2, 0.25, 0.3),
    *(0.36, 0.42, 0.48, 0.54, 0.6, 0.66, 0.72, 0.78, 0.84, 0.9, 0.96),
)
_RATIOS = (0.0, 0.15, 0.35, 0.6, 1.0)
_STARTS = (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9)
_SEEDS = 4
_FINEST = 0.0004


@dataclass(frozen=True, slots=True)
class Candidate:
    """A valve and a process: stick band, ratio ``J/S``, start position as a share of ``fS``."""

    cost: float
    band: float
    ratio: float
    start: float
    structure: Structure
    dead_time: int

    @property
    def jump(self) -> float:
        """Slip jump."""
        return self.band * self.ratio


@cache
def _coarse_valves() -> tuple[Array, Array, Array]:
    grids = np.meshgrid(_BANDS, _RATIOS, _STARTS, indexing="ij")
    band, ratio, start = (np.ascontiguousarray(g.ravel()) for g in grids)
    return band, ratio, start


def stem_of(u: Array, band: Array, ratio: Array, start: Array) -> Array:
    """Stems ``(n, m)`` of candidates; the start is ``u_0`` plus a share of the static friction."""
    jump = band * ratio
    return stems(u, band, jump, u[0] + start * 0.5 * (band + jump))


def valve_search(u: Array, regression: Regression) -> tuple[Candidate, ...]:
    """Best candidates of the window, best first, one per refined seed.

    ``u`` is the scaled OP, shape ``(n,)``.
    """
    band, ratio, start = _coarse_valves()
    lags = _lags(regression)
    stem = regression.whiten(stem_of(u, band, ratio, start))
    seeds = []
    for structure in COARSE:
        cost = regression.costs(stem, structure, lags)
        d, i = np.unravel_index(int(cost.argmin()), cost.shape)
        seeds.append(
            Candidate(float(cost[d, i]), band[i], ratio[i], start[i], structure, lags[int(d)])
        )
    seeds.sort(key=lambda seed: seed.cost)
    refined = [refine(u, regression, seed) for seed in seeds[:_SEEDS]]
    return tuple(sorted(refined, key=lambda c: c.cost))


def refine(u: Array, regression: Regression, seed: Candidate, step: float = 0.03) -> Candidate:
    """Zoom in on ``seed``: a small grid in every non-linear parameter, narrower each time."""
    best = seed
    ratio_step, start_step, factor = 0.2, 0.25, 1.45
    offsets = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    while step > _FINEST:
        grids = np.meshgrid(
            np.unique(np.clip(best.band + step * offsets, 1e-4, 1.2)),
            np.unique(np.clip(best.ratio + ratio_step * offsets, 0.0, 1.0)),
            np.unique(np.clip(best.start + start_step * offsets[::2], -1.0, 1.0)),
            indexing="ij",
        )
        band, ratio, start = (np.ascontiguousarray(g.ravel()) for g in grids)
        stem = regression.whiten(stem_of(u, band, ratio, start))
        lags = tuple(
            d for d in range(best.dead_time - 1, best.dead_time + 2) if 0 <= d <= regression.max_lag
        )
        for structure in best.structure.neighbours(factor):
            cost = regression.costs(stem, structure, lags)
            d, i = np.unravel_index(int(cost.argmin()), cost.shape)
            if cost[d, i] < best.cost:
                best = Candidate(
                    float(cost[d, i]), band[i], ratio[i], start[i], structure, lags[int(d)]
                )
        step *= 0.6
        ratio_step *= 0.65
        start_step *= 0.7
        factor = 1.0 + (factor - 1.0) * 0.65
    return best


def healthy_search(u: Array, regression: Regression) -> Candidate:
    """The best process with a healthy valve (the stem is OP), searched with the same freedom."""
    stem = regression.whiten(np.ascontiguousarray(u[:, None]))
    best = Candidate(np.inf, 0.0, 0.0, 0.0, COARSE[0], 0)
    lags = _lags(regression)
    best = _better(best, regression, stem, COARSE, lags)
    factor = 1.45
    for _ in range(8):
        near = tuple(
            d for d in range(best.dead_time - 1, best.dead_time + 2) if 0 <= d <= regression.max_lag
        )
        best = _better(best, regression, stem, best.structure.neighbours(factor), near)
        factor = 1.0 + (factor - 1.0) * 0.65
    return best


def _better(
    best: Candidate,
    regression: Regression,
    stem: Array,
    structures: tuple[Structure, ...] | list[Structure],
    lags: tuple[int, ...],
) -> Candidate:
    for structure in structures:
        cost = regression.costs(stem, structure, lags)[:, 0]
        d = int(cost.argmin())
        if cost[d] < best.cost:
            best = replace(best, cost=float(cost[d]), structure=structure, dead_time=lags[d])
    return best


def _lags(regression: Regression) -> tuple[int, ...]:
    return tuple(d for d in _LAGS if d <= regression.max_lag)
