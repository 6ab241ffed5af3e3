"""The search for the valve under the simulation criterion: coarse first, then closer and closer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

from estimator._kernels import Array, Index
from estimator._refine import Search, refine_process, refine_simulated
from estimator._simulated import simulated_coarse
from estimator._slips import Op, slips
from estimator.candidate import Candidate, first_apart
from estimator.regression import Regression
from estimator.structures import COARSE

__all__ = [
    "HOPELESS",
    "MIN_MOVES",
    "adopted",
    "followed",
    "follows",
    "healthy_refined",
    "healthy_search",
    "polished",
    "process_search",
    "restructured",
    "shortened",
    "shortest",
    "valve_search",
]

MIN_MOVES = 2
"""A stem that moves less often explains a step, not a valve."""

_COARSE_BANDS = (0.015, 0.03, 0.05, 0.08, 0.11, *np.arange(0.14, 1.02, 0.035))
_LAGS = 21
_FOLLOWS = 6
"""A valve that slips at every sixth sample follows OP: a healthy one is near enough."""
_LAG_GROUPS = ((0, 1), (2, 4), (5, 8), (9, 14), (15, 17), (18, 20))
_STRATA = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.2)
_LIKELY = 20
_BEGUN, _SURVIVORS, _FINALISTS = 14, 4, 2
HOPELESS = 0.98
"""Where no valve leaves less than this share of what a healthy one leaves, none is zoomed in on."""
_APART = 0.03
_WIDE = (0.03, 0.2, 0.1, 0.4)
_CLOSE = (0.006, 0.15, 0.04, 0.2)
"""Half-widths: stick band, slip jump, lead as shares of OP's span, logarithm of time constants."""
_HARDLY = 0.004
"""A stick band that changes nothing, as a share of OP's span."""
_TOLERATED = 1.12
_CLEAN = 0.02
_SHORTER = (1, 3, 6, 10)
_SENT, _BETTER = 4, 0.9
_FAR = 2.0
"""What a wide look leaves above the limit by this factor, a close one does not bring below it."""
_SHRINK = np.array([0.5, 0.6, 0.5, 0.6])


def _planes(band: int, jump: int, lead: int) -> Index:
    """A box of so many stick bands, slip jumps and leads, plane by plane: hardly less, far sooner.

    Valves of one pair of parameters are looked at with the third where it was best so far.
    """
    return np.array([[band, jump, 1], [band, 1, lead], [1, jump, lead]])


_ROUGH, _FIRST = np.array([[7, 1, 3]]), np.array([[7, 3, 5]])
"""For a valve that follows OP; for the first look at a seed, a whole box: its way is not known."""
_FEW = np.array([[7, 3, 1], [1, 3, 5]])
_SOME, _MANY = _planes(9, 5, 7), _planes(11, 5, 9)


@cache
def _coarse_valves() -> Array:
    """Valves of the coarse pass, ``(m, 4)``: S, J, lead, first direction.

    Where the noise is small enough for a finer grid, the one-step criterion's valves are better.
    """
    axes = _COARSE_BANDS, (0.1, 0.4, 0.9), (0.1, 0.35, 0.6, 0.85, 1.05), (1.0, -1.0)
    grids = np.meshgrid(*(np.array(axis) for axis in axes), indexing="ij")
    band, ratio, lead, first = (grid.ravel() for grid in grids)
    return np.ascontiguousarray(np.stack([band, ratio * band, lead * band, first], axis=1))


def valve_search(
    op: Op, regression: Regression, healthy: Candidate, others: tuple[Candidate, ...]
) -> tuple[Candidate, ...]:
    """Best candidates of the window, best first; empty when no valve of the grid moves.

    ``others`` are valves that another criterion likes; their processes are looked for. ``healthy``
    is the process behind a healthy valve: one that hardly sticks is near.
    """
    seeds = _seeds(op, regression, others)
    seeds.sort(key=lambda pair: pair[0].cost)
    hardly = replace(healthy, band=_HARDLY, jump=0.5 * _HARDLY, lead=0.5 * _HARDLY)
    seeds = [*seeds[:_BEGUN], (hardly, _CLOSE)]
    alive = [_refined(op, regression, seed, half, _FIRST, 1) for seed, half in seeds]
    alive.sort(key=lambda candidate: candidate.cost)
    kept = _diverse(alive, _SURVIVORS)
    alive = [_refined(op, regression, c, _CLOSE, _FEW, 3) for c in kept]
    alive.sort(key=lambda candidate: candidate.cost)
    if alive[0].cost > HOPELESS * healthy.cost:
        return tuple(_diverse(alive, _FINALISTS))
    half = tuple(0.5 * width for width in _CLOSE)
    ended = [_refined(op, regression, c, half, _SOME, 3) for c in _diverse(alive, _FINALISTS)]
    ended.sort(key=lambda candidate: candidate.cost)
    if not np.isfinite(ended[0].cost):
        return ()
    return (polished(op, regression, ended[0]), *ended[1:])


def polished(op: Op, regression: Regression, candidate: Candidate) -> Candidate:
    """The candidate refined on a fine lattice, under this regression's cost."""
    return _refined(op, regression, candidate, _CLOSE, _MANY, 4)


def follows(op: Op, candidate: Candidate) -> bool:
    """Whether the stem all but follows OP: there is no valve to be told."""
    at, _ = slips(op, candidate.band, candidate.jump, candidate.lead, candidate.first)
    return at.size > op.u.size // _FOLLOWS


def followed(op: Op, regression: Regression, candidate: Candidate) -> Candidate:
    """The candidate where it moves to under this regression's cost: little, but exactly."""
    return _refined(op, regression, candidate, _CLOSE, _FEW, 2)


def adopted(op: Op, regression: Regression, other: Candidate) -> Candidate:
    """The valve of another criterion with the process that serves it best, refined."""
    tables = tuple(regression.tables(structure) for structure in COARSE)
    cost = simulated_coarse(op, tables, other.valve[None], regression.max_lag + 1, op.u.size)[
        :, :, 0
    ]
    near = slice(max(other.dead_time - 2, regression.min_lag), other.dead_time + 2)
    part = cost[:, near]
    if not np.isfinite(part).any():
        return replace(other, cost=np.inf)
    place = np.unravel_index(int(part.argmin()), part.shape)
    structure, dead_time = COARSE[int(place[0])], near.start + int(place[1])
    seed = replace(other, structure=structure, dead_time=dead_time)
    return _refined(op, regression, seed, _CLOSE, _SOME, 4)


def restructured(op: Op, regression: Regression, best: Candidate) -> tuple[Candidate, ...]:
    """The valve of ``best`` with processes of every structure, all refined; best first."""
    tables = tuple(regression.tables(structure) for structure in COARSE)
    cost = simulated_coarse(op, tables, best.valve[None], regression.max_lag + 1, op.u.size)
    cost[:, : regression.min_lag] = np.inf
    seeds: dict[str, Candidate] = {}
    for structure, costs in zip(COARSE, cost[:, :, 0], strict=True):
        lag = int(costs.argmin())
        seed = replace(best, cost=float(costs[lag]), structure=structure, dead_time=lag)
        known = seeds.get(structure.name, seed)
        seeds[structure.name] = min(seed, known, key=lambda candidate: candidate.cost)
    found = [_refined(op, regression, seed, _CLOSE, _FEW, 3) for seed in seeds.values()]
    first = min(found, key=lambda candidate: candidate.cost)
    found = [polished(op, regression, c) if c is first else c for c in found]
    return tuple(sorted((best, *found), key=lambda candidate: candidate.cost))


def shortened(op: Op, regression: Regression, best: Candidate, by: int = 1) -> Candidate:
    """The candidate of the shortest dead time that explains PV about as well as ``best``.

    Where OP ramps, a longer dead time and a narrower stick band give nearly the same PV, and the
    small difference is decided by what the low-order process leaves out: that is what remains where
    nearly all of PV is explained. The dead time then takes no more than PV demands. Where noise
    remains, costs are likelihoods and only what cannot be told apart is shortened. Dead times are
    tried that are shorter ``by`` so many samples at least.
    """
    clean = best.cost < _CLEAN * regression.total
    limit = best.cost * (_TOLERATED if clean else 1.0 + 4.0 / regression.count)
    ramp = float(np.abs(np.diff(op.u)).mean())
    for longest in _SHORTER:
        if longest + by > best.dead_time:
            break
        # slips that come later by the samples that the dead time loses, upwards and downwards
        later = ramp * (best.dead_time - longest)
        seeds = [
            replace(best, dead_time=longest, band=best.band + share * later, lead=best.lead + later)
            for share in (1.0, 2.0)
        ]
        looks = [_refined(op, regression, seed, _WIDE, _FEW, 2, longest) for seed in seeds]
        nearer = min(looks, key=lambda candidate: candidate.cost)
        if nearer.cost > _FAR * limit:
            continue
        found = _refined(op, regression, nearer, _CLOSE, _SOME, 5, longest)
        if found.cost <= limit:
            return found
    return best


def shortest(
    op: Op, regression: Regression, found: tuple[Candidate, ...], sent: int = _SENT
) -> tuple[Candidate, ...]:
    """The candidates, best first, with their best one as of :func:`shortened` before them.

    On the way to it a candidate may leave a poor optimum; so ``sent`` of them are tried.
    """
    best = shortened(op, regression, found[0])
    for other in found[1:sent]:
        nearer = shortened(op, regression, other)
        if nearer.cost < _BETTER * best.cost:
            best = nearer
    return (best, *(one for one in found if one is not best))


def healthy_search(op: Op, regression: Regression) -> Candidate:
    """The best process with a healthy valve (the stem is OP), searched with the same freedom."""
    return process_search(op.u, regression)


def process_search(stem: Array, regression: Regression) -> Candidate:
    """The best process of all structures for a known stem, shape ``(n,)``."""
    best = np.empty(0)
    search = Search(1, regression.min_lag, regression.max_lag, regression.max_lag, _SHRINK)
    for structure in COARSE:
        state = Candidate(np.inf, 0.0, 0.0, 0.0, 1.0, structure, regression.min_lag).state()
        refine_process(regression.basis, stem, state, 0.0, search)
        if best.size == 0 or state[0] < best[0]:
            best = state
    return _process_refined(stem, regression, Candidate.of_state(best), 0.4, 5)


def healthy_refined(
    op: Op, regression: Regression, near: Candidate, width: float = 0.4, passes: int = 5
) -> Candidate:
    """The best process with a healthy valve near another, by ``width`` in log time constants."""
    return _process_refined(op.u, regression, near, width, passes)


def _process_refined(
    stem: Array, regression: Regression, near: Candidate, width: float, passes: int
) -> Candidate:
    state = near.state()
    search = Search(passes, regression.min_lag, regression.max_lag, 2, _SHRINK)
    refine_process(regression.basis, stem, state, width, search)
    return Candidate.of_state(state)


def _refined(
    op: Op,
    regression: Regression,
    candidate: Candidate,
    half: tuple[float, ...],
    boxes: Index,
    passes: int,
    longest: int | None = None,
) -> Candidate:
    limit = regression.max_lag if longest is None else longest
    state = candidate.anchored(op).state()
    state[5] = min(max(state[5], regression.min_lag), limit)
    if follows(op, candidate):
        # there is no valve to be told, and every evaluation costs hundreds of slips
        boxes, passes = _ROUGH, min(passes, 2)
    search = Search(passes, regression.min_lag, limit, 2, _SHRINK)
    refine_simulated(op, regression.basis, state, np.array(half), boxes, search)
    return Candidate.of_state(state)


def _diverse(ranked: list[Candidate], count: int) -> list[Candidate]:
    """The first ones whose stick bands are apart, at most ``count``."""
    finite = (candidate for candidate in ranked if np.isfinite(candidate.cost))
    found = first_apart(finite, count, lambda one, other: abs(one.band - other.band) > _APART)
    return found or ranked[:1]


def _seeds(
    op: Op, regression: Regression, others: tuple[Candidate, ...]
) -> list[tuple[Candidate, tuple[float, ...]]]:
    """Where to look closer, and how wide."""
    lags = min(_LAGS, regression.max_lag + 1)
    most = op.u.size // _FOLLOWS
    tables = tuple(regression.tables(structure) for structure in COARSE)
    valves = _coarse_valves()
    if others:
        valves = np.vstack([valves, *(other.valve[None] for other in others)])
    cost = np.full((len(COARSE), lags, valves.shape[0]), np.inf)
    cost[::2] = simulated_coarse(op, tables[::2], valves, lags, most)
    # what no second process likes, the ones between like no better
    least = cost[::2].min(axis=(0, 1))
    bands = valves[:, 0]
    likely = [
        inside[np.argsort(least[inside], kind="stable")[:_LIKELY]]
        for inside in (
            np.flatnonzero((bands >= narrow) & (bands < wide)) for narrow, wide in pairwise(_STRATA)
        )
    ]
    chosen = np.unique(np.concatenate([*likely, np.arange(_coarse_valves().shape[0], bands.size)]))
    cost[1::2][:, :, chosen] = simulated_coarse(op, tables[1::2], valves[chosen], lags, most)
    cost[:, : regression.min_lag] = np.inf
    grid = cost[:, :, : _coarse_valves().shape[0]]
    if not np.isfinite(grid).any():
        return []

    def seed(place: tuple[int, int, int]) -> Candidate:
        structure, lag, j = (int(i) for i in place)
        band, jump, lead, first = (float(v) for v in valves[j])
        found = float(cost[structure, lag, j])
        return Candidate(found, band, jump, lead, first, COARSE[structure], lag)

    found = []
    for low, high in _LAG_GROUPS:
        part = grid[:, low : high + 1]
        if part.size:
            place = np.unravel_index(int(part.argmin()), part.shape)
            found.append((seed((int(place[0]), low + int(place[1]), int(place[2]))), _WIDE))
    for number, costs in enumerate(grid):
        place = np.unravel_index(int(costs.argmin()), costs.shape)
        found.append((seed((number, int(place[0]), int(place[1]))), _WIDE))
    bands = valves[: grid.shape[2], 0]
    for narrow, wide in pairwise(_STRATA):
        inside = np.flatnonzero((bands >= narrow) & (bands < wide))
        place = np.unravel_index(int(grid[:, :, inside].argmin()), (*grid.shape[:2], inside.size))
        found.append((seed((int(place[0]), int(place[1]), int(inside[place[2]]))), _WIDE))
    for i, other in enumerate(others, start=grid.shape[2]):
        near = slice(max(other.dead_time - 1, regression.min_lag), other.dead_time + 1)
        part = cost[:, near, i]
        if part.size and np.isfinite(part).any():
            place = np.unravel_index(int(part.argmin()), part.shape)
            found.append((seed((int(place[0]), near.start + int(place[1]), i)), _CLOSE))
    return [pair for pair in found if np.isfinite(pair[0].cost)]
