"""The search for the valve: exhaustive and coarse first, then refined around the best cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from estimator._kernels import Array, stems
from estimator.coarse import LAGS, coarse_costs, coarse_valves
from estimator.regression import Regression
from estimator.structures import COARSE, Structure

__all__ = [
    "MIN_MOVES",
    "SCANS",
    "SCAN_PASSES",
    "Candidate",
    "Scan",
    "Seed",
    "Steps",
    "diverse",
    "first_position",
    "healthy_search",
    "lattice",
    "polished",
    "shortened",
    "stem_of",
    "valve_grid",
    "valve_search",
]

MIN_MOVES = 2
"""A stem that moves less often explains a step, not a valve."""

_SEEDS = 4
_STRATA = (0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.2)
_FINALISTS = 3
_APART = 0.03
_EARLY_PASSES = 3
_LATE_PASSES = 8
_TOLERATED = 1.12
_CLEAN = 0.02
_SHORTER = (1, 3, 6, 10)
_SCAN_SEEDS = 5
_OFFSETS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
_LAG_GROUPS = ((0, 1), (2, 3), (5, 8), (12, 18))


@dataclass(frozen=True, slots=True)
class Candidate:
    """A valve and a process: stick band, ratio ``J/S``, first position, see `first_position`."""

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

    @property
    def side(self) -> float:
        """-1 where the first slip is upwards, 1 where it is downwards."""
        return -1.0 if self.start < 0.0 else 1.0

    @property
    def lead(self) -> float:
        """How far OP has to go until the first slip on the candidate's side."""
        return min(2.0 * (1.0 - abs(self.start)) * self.band, self.band + self.jump)

    def anchored(self, u: Array) -> Candidate:
        """The same valve, its first position told by the slip that really comes first."""
        stem = self.stem(u)
        first = float(u[0]) + self.side * (0.5 * (self.band + self.jump) - self.lead)
        moved = np.flatnonzero(np.abs(stem - first) > 1e-12)
        if moved.size == 0:
            return self
        side = -1.0 if stem[moved[0]] > first else 1.0
        if side == self.side:
            return self
        lead = self.band + self.jump - self.lead
        return replace(self, start=side * max(1.0 - lead / (2.0 * self.band), 1e-9))

    def stem(self, u: Array) -> Array:
        """Its stem for OP ``u``, shape ``(n,)``."""
        one = np.ones(1)
        stem: Array = stem_of(u, self.band * one, self.ratio * one, self.start * one)[0][:, 0]
        return stem


@dataclass(frozen=True, slots=True)
class Seed:
    """A valve worth refining: S in units of OP's span, ``J/S``, first position, dead time."""

    band: float
    ratio: float
    start: float
    dead_time: int
    cost: float

    def like(self, candidate: Candidate, structure: Structure | None = None) -> Candidate:
        """The seed as a candidate with the process structure of another, or a given one."""
        return replace(
            candidate,
            cost=np.inf,
            band=self.band,
            ratio=self.ratio,
            start=self.start,
            dead_time=self.dead_time,
            structure=structure or candidate.structure,
        )


@dataclass(frozen=True, slots=True)
class Steps:
    """Half-widths of one zoom."""

    band: float = 0.035
    ratio: float = 0.2
    start: float = 0.15
    factor: float = 1.5
    lag: int = 2

    def narrower(self) -> Steps:
        """The steps of the next zoom."""
        return Steps(
            self.band * 0.6,
            self.ratio * 0.65,
            self.start * 0.7,
            1.0 + (self.factor - 1.0) * 0.65,
            1,
        )


_CLOSE = Steps(band=0.008, ratio=0.3, start=0.08)


@dataclass(frozen=True, slots=True)
class Scan:
    """Half-widths of a lattice: of the stick band as a share of itself, of ratio and start.

    The cost of a clean window is a field of narrow spikes, because a slip that is one sample off
    costs much; a zoom alone ends on a spike near the right one.
    """

    band: float
    ratio: float
    start: float

    def steps(self, band: float) -> Steps:
        """The zoom that follows."""
        return Steps(
            band=band * self.band / 10.0,
            ratio=self.ratio / 5.0,
            start=self.start / 6.0,
            factor=1.2,
            lag=1,
        )


SCANS = (Scan(0.3, 0.5, 1.0), Scan(0.08, 0.25, 0.3), Scan(0.02, 0.1, 0.1))
"""Lattices that follow each other, finer each time."""

SCAN_PASSES = 6


def stem_of(u: Array, band: Array, ratio: Array, start: Array) -> tuple[Array, Array]:
    """Stems ``(n, m)`` of candidates and their moves ``(m,)``; see :func:`first_position`."""
    jump = band * ratio
    return stems(u, band, jump, u[0] + first_position(band, jump, start))


def first_position(band: Array, jump: Array, start: Array) -> Array:
    """Distance of the stem from OP before the first sample, shape ``(m,)``.

    ``start`` lies between -1 and 1. Where it is negative the first slip is upwards, after OP has
    risen by a lead of ``2 (1 + start) S``, at most ``S + J``; where it is positive, downwards. A
    valve of another slip jump then makes its first slip at the same sample, and while it makes one
    move per stroke all later ones too: its likelihood changes slowly with J instead of in spikes.
    """
    static = 0.5 * (band + jump)
    lead = np.minimum(2.0 * (1.0 - np.abs(start)) * band, band + jump)
    offset: Array = np.where(start < 0.0, lead - static, static - lead)
    return offset


def valve_search(
    u: Array, regression: Regression, others: tuple[Seed, ...] = ()
) -> tuple[Candidate, ...]:
    """Best candidates of the window, best first; empty when no valve of the grid moves.

    ``u`` is the scaled OP, shape ``(n,)``; ``others`` are valves that another criterion likes.
    """
    alive = [_zoomed(u, regression, seed, Steps(), _EARLY_PASSES) for seed in _seeds(u, regression)]
    for other in others if alive else ():
        seed = other.like(alive[0][0], _structure_for(u, regression, other)).anchored(u)
        alive.append(_zoomed(u, regression, seed, _CLOSE, _EARLY_PASSES))
    alive.sort(key=lambda pair: pair[0].cost)
    chosen = diverse(
        np.array([seed.cost for seed, _ in alive]),
        np.array([seed.band for seed, _ in alive]),
        _APART,
        _FINALISTS,
    )
    ended = []
    for i in chosen:
        ended.append(_zoomed(u, regression, *alive[i], _LATE_PASSES))
    ranked = sorted((c for c, _ in ended if np.isfinite(c.cost)), key=lambda c: c.cost)
    if not ranked:
        return ()
    # a wide lattice for each, finer ones for the best of them
    ranked = [_scanned(u, regression, candidate, SCANS[0]) for candidate in ranked]
    ranked.sort(key=lambda c: c.cost)
    best = ranked[0]
    for scan in SCANS[1:]:
        best = _scanned(u, regression, best, scan)
    return (best, *ranked[1:])


def lattice(best: Candidate, scan: Scan) -> list[Array]:
    """A fine lattice of stick bands, ratios and starts around a candidate, flat, ``(m,)`` each."""
    grids = np.meshgrid(
        best.band * (1.0 + scan.band * np.linspace(-1.0, 1.0, 33)),
        np.unique(np.clip(best.ratio + scan.ratio * np.linspace(-1.0, 1.0, 9), 0.0, 1.0)),
        np.unique(np.clip(best.start + scan.start * np.linspace(-1.0, 1.0, 9), -1.0, 1.0)),
        indexing="ij",
    )
    return [np.ascontiguousarray(grid.ravel()) for grid in grids]


def diverse(cost: Array, band: Array, apart: float, count: int) -> list[int]:
    """Indices of the best nodes whose stick bands are ``apart``, at most ``count``."""
    found: list[int] = []
    for i in np.argsort(cost, kind="stable"):
        if all(abs(band[i] - band[j]) > apart for j in found):
            found.append(int(i))
            if len(found) == count:
                break
    return found


def _scanned(
    u: Array, regression: Regression, best: Candidate, scan: Scan, longest: int | None = None
) -> Candidate:
    limit = regression.max_lag if longest is None else longest
    band, ratio, start = lattice(best, scan)
    stem, moves = stem_of(u, band, ratio, start)
    lags = _near(regression, best, Steps(), limit)
    cost = regression.costs(regression.whiten(stem), best.structure, lags)
    cost[:, moves < MIN_MOVES] = np.inf
    pick = cost.argmin(axis=0)
    least = cost[pick, np.arange(band.size)]
    steps = scan.steps(best.band)
    found = [best]
    for i in diverse(least, band, 0.05 * scan.band * best.band, _SCAN_SEEDS):
        seed = replace(
            best,
            cost=float(least[i]),
            band=float(band[i]),
            ratio=float(ratio[i]),
            start=float(start[i]),
            dead_time=lags[int(pick[i])],
        )
        found.append(_zoomed(u, regression, seed, steps, SCAN_PASSES, limit)[0])
    return min(found, key=lambda candidate: candidate.cost)


def polished(u: Array, regression: Regression, candidate: Candidate) -> Candidate:
    """The candidate refined under another regression's cost."""
    seed = replace(candidate, cost=np.inf)
    return _zoomed(u, regression, seed, Steps(), _LATE_PASSES)[0]


def shortened(u: Array, regression: Regression, best: Candidate) -> Candidate:
    """The candidate of the shortest dead time that explains PV about as well as ``best``.

    Where OP ramps, a longer dead time and a narrower stick band give nearly the same PV, and the
    small difference is decided by what the low-order process leaves out: that is what remains where
    nearly all of PV is explained. The dead time then takes no more than PV demands. Where noise
    remains, costs are likelihoods and only what cannot be told apart is shortened.
    """
    clean = best.cost < _CLEAN * regression.total
    limit = best.cost * (_TOLERATED if clean else 1.0 + 4.0 / regression.count)
    ramp = float(np.abs(np.diff(u)).mean())
    for longest in _SHORTER:
        if longest >= best.dead_time:
            break
        band = best.band + ramp * (best.dead_time - longest)
        seed = replace(best, cost=np.inf, dead_time=longest, band=band)
        scanned = _scanned(u, regression, seed, SCANS[0], longest)
        found, _ = _zoomed(u, regression, scanned, Steps(), _LATE_PASSES, longest)
        if found.cost <= limit:
            return found
    return best


def _structure_for(u: Array, regression: Regression, seed: Seed) -> Structure:
    """The structure of the coarse list that serves a valve best."""
    stem = regression.whiten(
        stem_of(u, *(np.array([v]) for v in (seed.band, seed.ratio, seed.start)))[0]
    )
    lags = tuple(d for d in (seed.dead_time - 1, seed.dead_time) if d <= regression.max_lag)
    return min(COARSE, key=lambda one: float(regression.costs(stem, one, lags).min()))


def _seeds(u: Array, regression: Regression) -> list[Candidate]:
    band, ratio, start = coarse_valves()
    stem, moves = stem_of(u, band, ratio, start)
    moving = moves >= MIN_MOVES
    band, ratio, start = band[moving], ratio[moving], start[moving]
    if band.size == 0:
        return []
    stem = np.ascontiguousarray(stem[:, moving])
    lags = tuple(d for d in LAGS if d <= regression.max_lag)
    found: dict[tuple[str, int], Candidate] = {}
    lagged: dict[float, Array] = {}
    least = np.full(band.size, np.inf)
    origin = np.zeros((band.size, 2), dtype=np.int64)
    for number, structure in enumerate(COARSE):
        if structure.slow not in lagged:
            lagged[structure.slow] = Structure(structure.slow, 0.0).response(stem)
        response = lagged[structure.slow]
        if structure.fast > 0.0:
            response = Structure(structure.fast, 0.0).response(response)
        cost = coarse_costs(regression.y, regression.good, response, structure, lags)
        lowest = cost.min(axis=0)
        better = lowest < least
        least[better] = lowest[better]
        origin[better] = np.stack([np.full(band.size, number), cost.argmin(axis=0)], axis=1)[better]
        for group, members in enumerate(_LAG_GROUPS):
            rows = [i for i, d in enumerate(lags) if d in members]
            if not rows:
                continue
            i, j = np.unravel_index(int(cost[rows].argmin()), (len(rows), band.size))
            row = rows[int(i)]
            seed = Candidate(float(cost[row, j]), band[j], ratio[j], start[j], structure, lags[row])
            key = structure.name, group
            if key not in found or seed.cost < found[key].cost:
                found[key] = seed
    ranked = sorted(found.values(), key=lambda seed: seed.cost)[:_SEEDS]
    for low, high in pairwise(_STRATA):
        inside = np.flatnonzero((band >= low) & (band < high))
        if inside.size == 0:
            continue
        top = int(inside[least[inside].argmin()])
        at = COARSE[int(origin[top, 0])], lags[int(origin[top, 1])]
        ranked.append(Candidate(float(least[top]), band[top], ratio[top], start[top], *at))
    return [replace(seed, cost=np.inf) for seed in ranked]


def _zoomed(
    u: Array,
    regression: Regression,
    best: Candidate,
    steps: Steps,
    passes: int,
    longest: int | None = None,
) -> tuple[Candidate, Steps]:
    limit = regression.max_lag if longest is None else longest
    for _ in range(passes):
        lags = _near(regression, best, steps, limit)
        best = _best_of(u, regression, best, valve_grid(best, steps), [best.structure], lags)
        lags = _near(regression, best, steps, limit)
        near = best.structure.neighbours(steps.factor)
        best = _best_of(u, regression, best, _band_grid(best, steps), near, lags)
        steps = steps.narrower()
    return best, steps


def valve_grid(best: Candidate, steps: Steps) -> list[Array]:
    """Stick bands, ratios and starts around a candidate, flat, shape ``(m,)`` each."""
    grids = np.meshgrid(
        np.unique(np.clip(best.band + steps.band * _OFFSETS, 1e-4, 1.2)),
        np.unique(np.clip(best.ratio + steps.ratio * _OFFSETS, 0.0, 1.0)),
        np.unique(np.clip(best.start + steps.start * _OFFSETS[::2], -1.0, 1.0)),
        indexing="ij",
    )
    return [np.ascontiguousarray(grid.ravel()) for grid in grids]


def _band_grid(best: Candidate, steps: Steps) -> list[Array]:
    """Stick bands around a candidate: what the time constants and the dead time trade against."""
    band = np.unique(np.clip(best.band + steps.band * _OFFSETS, 1e-4, 1.2))
    return [band, np.full(band.size, best.ratio), np.full(band.size, best.start)]


def _near(regression: Regression, best: Candidate, steps: Steps, longest: int) -> tuple[int, ...]:
    around = range(best.dead_time - steps.lag, best.dead_time + steps.lag + 1)
    return tuple(d for d in around if regression.min_lag <= d <= longest)


def _best_of(
    u: Array,
    regression: Regression,
    best: Candidate,
    valves: list[Array],
    structures: list[Structure],
    lags: tuple[int, ...],
) -> Candidate:
    band, ratio, start = (np.ascontiguousarray(v) for v in valves)
    stem, moves = stem_of(u, band, ratio, start)
    stem = regression.whiten(stem)
    for structure in structures:
        cost = regression.costs(stem, structure, lags)
        cost[:, moves < MIN_MOVES] = np.inf
        d, i = np.unravel_index(int(cost.argmin()), cost.shape)
        if cost[d, i] < best.cost:
            best = Candidate(
                float(cost[d, i]),
                float(band[i]),
                float(ratio[i]),
                float(start[i]),
                structure,
                lags[int(d)],
            )
    return best


def healthy_search(u: Array, regression: Regression) -> Candidate:
    """The best process with a healthy valve (the stem is OP), searched with the same freedom."""
    stem = regression.whiten(np.ascontiguousarray(u[:, None]))
    best = Candidate(np.inf, 0.0, 0.0, 0.0, COARSE[0], regression.min_lag)
    lags = tuple(d for d in LAGS if regression.min_lag <= d <= regression.max_lag)
    best = _better(best, regression, stem, COARSE, lags)
    steps = Steps()
    for _ in range(8):
        near = best.structure.neighbours(steps.factor)
        around = _near(regression, best, steps, regression.max_lag)
        best = _better(best, regression, stem, near, around)
        steps = steps.narrower()
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
