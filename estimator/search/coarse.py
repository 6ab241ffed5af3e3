"""The first look at all valves: many stems, a few processes, one noise model at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from estimator.algebra import order_of
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.nuisances import Nuisance
from estimator.lanes import respond
from estimator.processes.poles import COARSE
from estimator.search.descent import LEAST_BAND, WIDEST_BAND, Descent, Found
from estimator.search.one_step import OneStep
from estimator.search.processes import spread_points
from estimator.settings import Searching
from estimator.valves.laws import LAWS

__all__ = ["Look", "first_apart", "one_step_starts", "simulated_starts"]

_BLOCK = 32
"""Valves of a block: its signals stay in the cache."""
_MANY_ROWS = 400
"""Judged rows from which every second one is enough for a ranking."""
_TRIAL = 5
"""Rounds that every seed of a look is followed; only the best ones go on."""
_PAST = 3
"""PV's own past in the ranking by one-step errors, samples."""
_SHIFTS = 6
"""Dead times of that ranking."""
_TOPS, _NEAR = 16, 40
"""Valves of that ranking that are looked around, and valves around each."""
_REACHES = (0.03, 0.012, 0.005)
"""How far around them, as shares of S."""


@cache
def _table(bands: tuple[float, ...], jumps: tuple[float, ...], starts: tuple[float, ...]) -> Array:
    """S, J and the start in shares of fS, ``(m, 3)``."""
    table = np.array(list(product(bands, jumps, starts)))
    table[:, 1] *= table[:, 0]
    table.flags.writeable = False
    return table


@cache
def _fine_bands(searching: Searching) -> tuple[float, ...]:
    """Return stick bands: narrow ones in steps of one ratio, wide ones in steps of one width."""
    low, high = searching.bands[0], searching.bands[-1]
    return (*np.geomspace(low, 0.1, 18), *np.linspace(0.105, high, 88))


def _placed(table: Array, first_op: float) -> Array:
    """The valves with their start in units of OP's span."""
    valves = table.copy()
    valves[:, 2] = first_op + valves[:, 2] * 0.5 * (valves[:, 0] + valves[:, 1])
    return valves


def first_apart(bands: Array, costs: Array, count: int, share: float) -> list[int]:
    """The cheapest ones whose stick bands are apart by a ``share``, at most ``count``."""
    found: list[int] = []
    near = ~np.isfinite(costs)
    for i in order_of(costs):
        if len(found) == count:
            break
        if not near[i]:
            found.append(int(i))
            near |= np.abs(bands - bands[i]) <= share * np.maximum(bands, bands[i])
    return found


@dataclass(frozen=True, slots=True)
class Look:
    """What a first look takes for given: disturbances and a noise model, ``(p,)``."""

    nuisances: tuple[Nuisance, ...]
    taps: Array


def simulated_starts(
    case: Case, near: Hypothesis, looks: tuple[Look, ...], law: str
) -> list[tuple[Found, Look]]:
    """The best valves of a law under each look, drawn to the bottom of their valleys."""
    searching = case.settings.searching
    valves = _placed(_table(searching.bands, searching.jumps, searching.starts), case.rows.u[0])
    stride = 2 if case.rows.count > _MANY_ROWS else 1
    rankings = [_Ranking(case, near, look, len(valves)) for look in looks]
    _rank(case, rankings, valves, law, stride)
    found = []
    for look in rankings:
        ways = []
        for i in first_apart(valves[:, 0], look.cost, searching.seeds, searching.apart):
            poles = COARSE[look.process[i]]
            valve = Valve(float(valves[i, 0]), float(valves[i, 1]), float(valves[i, 2]), law)
            start = Found(float(look.cost[i]), valve, poles, int(look.late[i]))
            design = look.designs[poles.integrating]
            ways.append(Descent(case, design, start, searching.wide, searching.lanes, stride))
        for way in ways:
            way.go_on(_TRIAL)
        ways.sort(key=lambda way: way.squares)
        for way in ways[: searching.basins]:
            way.go_on(searching.generations - _TRIAL)
        ends = [way.found for way in ways]
        bands = np.array([end.valve.band for end in ends])
        squares = np.array([end.squares for end in ends])
        found += [(ends[i], look.look) for i in first_apart(bands, squares, searching.basins, 0.05)]
    return found


class _Ranking:
    """All valves under one look: cost, process and dead time of each."""

    def __init__(self, case: Case, near: Hypothesis, look: Look, valves: int) -> None:
        self.look = look
        self.designs = {
            integrating: case.design(
                look.nuisances,
                look.taps,
                near.stem,
                next(p for p in COARSE if p.integrating is integrating),
                near.dead_time,
            )
            for integrating in (False, True)
        }
        self.cost = np.full(valves, np.inf)
        self.process = np.zeros(valves, dtype=np.int64)
        self.late = np.zeros(valves, dtype=np.int64)


def _rank(case: Case, looks: list[_Ranking], valves: Array, law: str, stride: int) -> None:
    """Fill in every look: a response is computed once for all of them."""
    longest = case.max_dead_time
    delays = np.array([d for d in case.settings.searching.delays if d <= longest], dtype=np.int64)
    processes = np.array([p.coefficients for p in COARSE]).T.copy()
    for begin in range(0, len(valves), _BLOCK):
        block = slice(begin, min(begin + _BLOCK, len(valves)))
        stems = LAWS[law](case.rows.u, np.ascontiguousarray(valves[block]))
        useless = ~case.tells(stems)
        for number, poles in enumerate(COARSE):
            lanes = np.repeat(processes[:, number : number + 1], stems.shape[1], axis=1)
            responses = respond(stems, *lanes)
            for look in looks:
                design = look.designs[poles.integrating]
                costs = design.single(responses.copy(), delays, stride)
                best = costs.argmin(axis=0)
                least = costs[best, np.arange(costs.shape[1])]
                least[useless] = np.inf
                better = least < look.cost[block]
                look.cost[block] = np.where(better, least, look.cost[block])
                look.process[block] = np.where(better, number, look.process[block])
                look.late[block] = np.where(better, delays[best], look.late[block])


def one_step_starts(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...]
) -> list[tuple[Valve, int]]:
    """The best valves of He's law by one-step errors, with their dead times.

    The dead time is one sample or more: with direct feed-through the regression may learn the
    controller, which answers PV within the same scan, instead of the process.
    """
    searching = case.settings.searching
    shifts = min(_SHIFTS, case.max_dead_time - 3)
    if shifts < 1:
        return []
    table = _table(_fine_bands(searching), searching.fine_jumps, searching.fine_starts)
    valves = _placed(table, float(case.rows.u[0]))
    columns = case.columns(nuisances, near.stem, COARSE[0], near.dead_time)
    ranking = OneStep(case.rows, columns, _PAST)
    cost, late = ranking.costs(valves, 1, shifts)
    points = spread_points(_NEAR + 1, 3)[1:]
    for reach in _REACHES:
        # the best, and the best of each neighbourhood, so that not all stand in one valley
        tops = first_apart(valves[:, 0], cost, _TOPS, reach)
        tops = sorted({*tops, *(int(i) for i in order_of(cost)[:_TOPS])})
        tops = [top for top in tops if np.isfinite(cost[top])]
        more = np.vstack([_around(valves[top], points, reach) for top in tops] or [valves[:1]])
        more_cost, more_late = ranking.costs(more, 1, shifts)
        valves = np.vstack([valves, more])
        cost, late = np.concatenate([cost, more_cost]), np.concatenate([late, more_late])
    return [
        (Valve(float(valves[i, 0]), float(valves[i, 1]), float(valves[i, 2])), int(late[i]))
        for i in first_apart(valves[:, 0], cost, searching.basins, searching.apart)
    ]


def _around(valve: Array, points: Array, reach: float) -> Array:
    """Valves ``(m, 3)`` around one, ``reach`` wide as a share of S."""
    band = np.clip(valve[0] * np.exp(2.0 * reach * points[:, 0]), LEAST_BAND, WIDEST_BAND)
    jump = np.clip(valve[1] + 2.0 * reach * band * points[:, 1], 0.0, band)
    start = valve[2] + reach * band * points[:, 2]
    return np.ascontiguousarray(np.stack([band, jump, start], axis=1))
