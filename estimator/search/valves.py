"""Valves for a window: a coarse look at all of them under several noise models, then closer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
from scipy.special import ndtr, ndtri

from estimator.criteria.design import Design
from estimator.evidence.hypothesis import Case, Hypothesis, Valve
from estimator.evidence.nuisances import Nuisance
from estimator.lanes import Array, cholesky, count_moves
from estimator.processes.poles import COARSE, Poles, Shape, coefficients
from estimator.search.one_step import OneStep
from estimator.search.processes import polish, spread_points
from estimator.settings import Searching
from estimator.valves.laws import LAWS

__all__ = ["find_valve", "moved_valves", "refine_valve", "turned_points"]

_BLOCK = 32
"""Valves of a block: its signals stay in the cache."""
_BETTER = 1e-6
_FEWEST = 2


@cache
def _coarse_valves(searching: Searching) -> Array:
    """S, J and the start in shares of fS, ``(m, 3)``."""
    table = np.array(list(product(searching.bands, searching.jumps, searching.starts)))
    table[:, 1] *= table[:, 0]
    table.flags.writeable = False
    return table


def find_valve(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...] = ()
) -> Hypothesis | None:
    """The most likely sticky valve of the window; None where no valve moves often enough.

    Valves are looked at under white noise, nearly differenced noise and the noise of ``near``:
    which of them shows the valve depends on what else moves PV.
    """
    searching = case.settings.searching
    whiteners: list[Array] = [np.zeros(0), np.array([searching.differencing])]
    basins: list[Hypothesis] = []
    for taps in whiteners:
        for valve, poles, dead_time in _basins(case, near, nuisances, taps):
            basins.append(
                polish(case, valve, (poles, dead_time), nuisances, taps, passes=2, wide=False)
            )
    for valve, dead_time in _one_step_basins(case, near, nuisances):
        start = COARSE[4], dead_time
        basins.append(polish(case, valve, start, nuisances, near.taps, passes=3, wide=True))
    if not basins:
        return None
    basins.sort(key=lambda one: -one.likelihood)
    kept: list[Hypothesis] = []
    for one in basins:
        if len(kept) == searching.basins:
            break
        if all(_apart(one, other, searching.apart) for other in kept):
            kept.append(one)
    refined = [refine_valve(case, one) for one in kept]
    return max(refined, key=lambda one: one.likelihood)


@cache
def _fine_valves(searching: Searching) -> Array:
    """S, J and the start in shares of fS for the one-step ranking, ``(m, 3)``."""
    bands = np.concatenate([np.geomspace(0.02, 0.1, 18), np.linspace(0.105, 1.0, 90)])
    table = np.array(
        list(
            product(bands, (0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0), (-0.95, -0.5, 0.0, 0.5, 0.95))
        )
    )
    table[:, 1] *= table[:, 0]
    table.flags.writeable = False
    return table


def _one_step_basins(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...]
) -> list[tuple[Valve, int]]:
    """The best valves by one-step errors, with their dead times."""
    searching = case.settings.searching
    u = case.rows.u
    valves = _fine_valves(searching).copy()
    valves[:, 2] = u[0] + valves[:, 2] * 0.5 * (valves[:, 0] + valves[:, 1])
    columns = case.columns(nuisances, near.stem, COARSE[0], near.dead_time)
    ranking = OneStep(case.rows, columns, 3)
    shifts = min(6, case.max_dead_time - 1)
    cost, late = ranking.costs(valves, 1, shifts)
    reach = 0.03
    for _ in range(3):
        tops = np.argsort(cost, kind="stable")[:16]
        points = spread_points(33, 3)[1:]
        table = np.vstack([_around(valves[top], points, reach) for top in tops])
        more, later = ranking.costs(table, 1, shifts)
        valves = np.vstack([valves, table])
        cost, late = np.concatenate([cost, more]), np.concatenate([late, later])
        reach *= 0.4
    return [
        (Valve(*(float(v) for v in valves[i])), int(late[i]))
        for i in _first_apart(valves[:, 0], cost, searching.basins, searching.apart)
    ]


def _apart(one: Hypothesis, other: Hypothesis, share: float) -> bool:
    assert one.valve is not None
    assert other.valve is not None
    return abs(one.valve.band - other.valve.band) > share * max(one.valve.band, other.valve.band)


def _basins(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...], taps: Array
) -> list[tuple[Valve, Poles, int]]:
    """The best coarse valves under one noise model, drawn closer, with their processes."""
    searching = case.settings.searching
    u = case.rows.u
    valves = _coarse_valves(searching).copy()
    friction = 0.5 * (valves[:, 0] + valves[:, 1])
    valves[:, 2] = u[0] + valves[:, 2] * friction
    delays = np.array([d for d in searching.delays if d <= case.max_dead_time], dtype=np.int64)
    laws = ("he", "sliding")
    design = {
        integrating: case.design(
            nuisances,
            taps,
            near.stem,
            next(p for p in COARSE if p.integrating is integrating),
            near.dead_time,
        )
        for integrating in (False, True)
    }

    processes = np.array([p.coefficients for p in COARSE]).T.copy()

    def look(law: str, table: Array) -> tuple[Array, Array, Array]:
        cost = np.full(len(table), np.inf)
        process = np.zeros(len(table), dtype=np.int64)
        late = np.zeros(len(table), dtype=np.int64)
        for begin in range(0, len(table), _BLOCK):
            block = slice(begin, min(begin + _BLOCK, len(table)))
            stems = LAWS[law](u, np.ascontiguousarray(table[block]))
            moves = count_moves(stems)
            for number, poles in enumerate(COARSE):
                lanes = np.repeat(processes[:, number : number + 1], stems.shape[1], axis=1)
                costs = design[poles.integrating].single(stems, lanes, delays)
                best = costs.argmin(axis=0)
                least = np.where(moves >= _FEWEST, costs[best, np.arange(costs.shape[1])], np.inf)
                better = least < cost[block]
                cost[block] = np.where(better, least, cost[block])
                process[block] = np.where(better, number, process[block])
                late[block] = np.where(better, delays[best], late[block])
        return cost, process, late

    ends = []
    for law in laws:
        cost, process, late = look(law, valves)
        for i in _first_apart(valves[:, 0], cost, searching.seeds, searching.apart):
            poles = COARSE[process[i]]
            ends.append(
                _descend(
                    case,
                    design[poles.integrating],
                    valves[i],
                    poles,
                    int(late[i]),
                    law,
                    0.12,
                    searching.generations,
                )
            )
    bands = np.array([end[1].band for end in ends])
    costs = np.array([end[0] for end in ends])
    chosen = _first_apart(bands, costs, searching.basins, 0.3 * searching.apart)
    return [ends[i][1:] for i in chosen]


def _first_apart(bands: Array, costs: Array, count: int, share: float) -> list[int]:
    """The cheapest ones whose stick bands are apart by a ``share``, at most ``count``."""
    found: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if not np.isfinite(costs[i]) or len(found) == count:
            break
        if all(abs(bands[i] - bands[j]) > share * max(bands[i], bands[j]) for j in found):
            found.append(int(i))
    return found


def _descend(
    case: Case,
    design: Design,
    valve: Array,
    poles: Poles,
    dead_time: int,
    law: str,
    width: float,
    rounds: int,
) -> tuple[float, Valve, Poles, int]:
    """Valve and poles refined together under one noise model; the least sum of squares first.

    Samples of a normal distribution that learns the valley it lies in: its covariance becomes that
    of the best samples around the mean before (rank-mu update of CMA-ES; Hansen, The CMA evolution
    strategy: a tutorial, 2016). Stick band and time constants trade against each other along curved
    valleys, which steps in single parameters do not follow.
    """
    searching = case.settings.searching
    if poles.shape is Shape.LAGS:
        slow = max(poles.slow, 0.2)
        poles = replace(poles, slow=slow, fast=poles.fast or max(0.15, 0.3 * slow))
    elif poles.shape is Shape.INTEGRATING:
        poles = replace(poles, fast=poles.fast or 0.5)
    origin, middle = poles, np.zeros(5)
    root = np.diag(width * np.array([1.0, 2.0, 2.0, 3.0, 4.0]))
    chosen = searching.lanes // 4
    weight = np.log(chosen + 0.5) - np.log(np.arange(1.0, chosen + 1))
    weight /= weight.sum()
    least, best, late_best = np.inf, np.zeros(5), dead_time
    for turn in range(rounds):
        table = middle + turned_points(searching.lanes, 5, turn) @ root.T
        if turn:
            table[0] = best
        valves = moved_valves(valve, table)
        steps = np.column_stack([table[:, 3:5], np.zeros(len(table))])
        group = origin.moved(steps)
        stems = LAWS[law](case.rows.u, valves)
        shortest = max(0, late_best - 1)
        count = min(3, case.max_dead_time + 1 - shortest)
        costs = design.paired(stems, coefficients(origin.shape, group), shortest, count)
        lane_cost = costs.min(axis=0)
        order = np.argsort(lane_cost, kind="stable")[:chosen]
        if lane_cost[order[0]] < least * (1.0 - 1e-12):
            least = float(lane_cost[order[0]])
            best = table[order[0]].copy()
            late_best = shortest + int(costs[:, order[0]].argmin())
        steps = table[order] - middle
        spread = (steps * weight[:, None]).T @ steps
        middle = middle + weight @ steps
        covariance = 0.3 * root @ root.T + 0.7 * spread
        root = cholesky(covariance + 1e-16 * np.eye(5))
    found = moved_valves(valve, best[None])[0]
    band, jump, start = (float(v) for v in found)
    row = origin.moved(np.array([[best[3], best[4], 0.0]]))[0]
    return least, Valve(band, jump, start, law), origin.of_row(row), late_best


@cache
def turned_points(count: int, dimensions: int, turn: int) -> Array:
    """Another even set of points for every round."""
    shift = spread_points(64, dimensions)[(17 * turn) % 64]
    points = spread_points(count + 1, dimensions)[1:]
    shares = np.mod(ndtr(points) + ndtr(shift), 1.0)
    found: Array = ndtri(np.clip(shares, 1e-3, 1.0 - 1e-3))
    return found


def moved_valves(valve: Array, steps: Array) -> Array:
    """Valves ``(m, 3)`` from one by steps in log S, J / S and start / S."""
    band = np.clip(valve[0] * np.exp(steps[:, 0]), 0.004, 1.1)
    ratio = np.clip(valve[1] / valve[0] + steps[:, 1], 0.0, 1.0)
    return np.ascontiguousarray(
        np.stack([band, ratio * band, valve[2] + steps[:, 2] * band], axis=1)
    )


def _around(valve: Array, points: Array, reach: float) -> Array:
    """Valves ``(m, 3)`` around one, ``reach`` wide as a share of S."""
    band = np.clip(valve[0] * np.exp(2.0 * reach * points[:, 0]), 0.004, 1.1)
    jump = np.clip(valve[1] + 2.0 * reach * band * points[:, 1], 0.0, band)
    start = valve[2] + reach * band * points[:, 2]
    return np.ascontiguousarray(np.stack([band, jump, start], axis=1))


def refine_valve(
    case: Case, start: Hypothesis, reach: float = 0.05, law: str | None = None
) -> Hypothesis:
    """The hypothesis with valve and poles refined together, its noise model in turn."""
    assert start.valve is not None
    searching = case.settings.searching
    best = start
    if law is not None and law != start.valve.law:
        valve = replace(start.valve, law=law)
        best = case.fit(valve, start.poles, start.dead_time, start.nuisances, start.taps)
    for _ in range(3):
        valve, poles, dead_time = best.valve, best.poles, best.dead_time
        assert valve is not None
        name = valve.law
        design = case.design(best.nuisances, best.taps, best.stem, poles, dead_time)
        _, valve, poles, dead_time = _descend(
            case,
            design,
            np.array([valve.band, valve.jump, valve.start]),
            poles,
            dead_time,
            name,
            reach,
            searching.rounds,
        )
        found = case.fit(valve, poles, dead_time, best.nuisances, best.taps)
        if found.likelihood <= best.likelihood + 0.05:
            best = max(best, found, key=lambda one: one.likelihood)
            break
        best = found
        reach *= 0.5
    return best
