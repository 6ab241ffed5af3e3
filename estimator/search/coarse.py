"""The first look at all valves: many stems, a few processes, one noise model at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from compiled import kernel
from estimator.algebra import stepped
from estimator.arrays import Array, Index
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.nuisances import Nuisance
from estimator.processes.poles import COARSE
from estimator.search.descent import Descent, Found
from estimator.search.one_step import OneStep, look_around
from estimator.search.ranking import Ranking
from estimator.settings import Searching

__all__ = ["Look", "first_apart", "one_step_starts", "ranking_of", "simulated_starts"]

_INTEGRATING = next(poles for poles in COARSE if poles.integrating)
_MANY_ROWS = 400
"""Judged rows from which every second one is enough for a ranking."""
_TRIAL = 3
"""Rounds that every seed of a look is followed; only the best ones go on."""
_SHIFTS = 6
"""Dead times of that ranking."""
_TOPS = 32
"""Valves of that ranking that are looked around: 16 are often all of one valley."""
_REACHES = (0.03, 0.012, 0.005)
"""How far around them, as shares of S."""
_NARROW = 0.1
"""Stick band (share of OP's span) below which steps are of one ratio, and above of one width."""
_FINE = 36, 0.005
"""Stick bands of that ranking, with every slip jump: narrow ones, and the step of wide ones."""
_SHARP, _SHARP_JUMPS, _SHARP_STARTS = (100, 0.001), (0.15, 0.4, 0.7, 1.0), (-0.95, 0.0, 0.95)
"""The same, with few slip jumps and first positions: S is how far OP travels from a slip one way to
one the other way, and of a hundred fast strokes each slip tells it again, to a thousandth of OP's
span. J then tells little (tuning family: steps of 0.01 alone lose the right valve in 11 of 88
windows that show one, by up to 630 nats and 38 % of S; with these it is 5)."""


@cache
def _table(bands: tuple[float, ...], jumps: tuple[float, ...], starts: tuple[float, ...]) -> Array:
    """S, J and the start in shares of fS, ``(m, 3)``."""
    table = np.array(list(product(bands, jumps, starts)))
    table[:, 1] *= table[:, 0]
    table.flags.writeable = False
    return table


@cache
def _fine_table(searching: Searching) -> Array:
    """Valves that one-step errors rank, as `_table`; see `_FINE` and `_SHARP`."""
    low, high = searching.bands[0], searching.bands[-1]
    parts = []
    for (narrow, step), jumps, starts in (
        (_FINE, searching.fine_jumps, searching.fine_starts),
        (_SHARP, _SHARP_JUMPS, _SHARP_STARTS),
    ):
        wide = np.arange(_NARROW + 0.5 * step, high, step)
        bands = (*np.geomspace(low, _NARROW, narrow), *(float(band) for band in wide))
        parts.append(_table(bands, jumps, starts))
    table = np.vstack(parts)
    table.flags.writeable = False
    return table


def _placed(table: Array, first_op: float) -> Array:
    """The valves with their start in units of OP's span."""
    valves = table.copy()
    valves[:, 2] = first_op + valves[:, 2] * 0.5 * (valves[:, 0] + valves[:, 1])
    return valves


def first_apart(bands: Array, costs: Array, count: int, share: float) -> list[int]:
    """The cheapest ones whose stick bands are apart by a ``share``, at most ``count``.

    All that are cheapest, whatever their stick bands, with a ``share`` below zero.
    """
    return [int(i) for i in _first_apart(bands, costs, count, share)]


@kernel
def _first_apart(bands: Array, costs: Array, count: int, share: float) -> Index:
    found = np.empty(min(count, bands.size), dtype=np.int64)
    left = np.where(np.isfinite(costs), stepped(costs), np.inf)
    some = 0
    while some < found.size:
        top = left.argmin()
        if not np.isfinite(left[top]):
            break
        found[some] = top
        some += 1
        left[top] = np.inf
        for i in range(bands.size):
            if abs(bands[i] - bands[top]) <= share * max(bands[i], bands[top]):
                left[i] = np.inf
    return found[:some]


@dataclass(frozen=True, slots=True)
class Look:
    """What a first look takes for given: disturbances and a noise model, ``(p,)``."""

    nuisances: tuple[Nuisance, ...]
    taps: Array


def ranking_of(case: Case, near: Hypothesis, looks: tuple[Look, ...]) -> Ranking:
    """All that a ranking of valves needs to know of the window under each look."""
    designs = []
    for look in looks:
        at_rest, integrating = (
            case.design(look.nuisances, look.taps, near.stem, poles, near.dead_time)
            for poles in (COARSE[0], _INTEGRATING)
        )
        designs.append((at_rest, integrating))
    soonest, longest = case.rows.soonest, case.max_dead_time
    delays = np.array(
        [d for d in case.settings.searching.delays if soonest <= d <= longest], dtype=np.int64
    )
    return Ranking(case, designs, delays)


def simulated_starts(
    case: Case, ranking: Ranking, looks: tuple[Look, ...], law: str
) -> list[tuple[Found, Look]]:
    """The best valves of a law under each look, drawn to the bottom of their valleys."""
    searching = case.settings.searching
    other = law != searching.laws[0]
    seeds, basins = searching.seeds[other], searching.basins[other]
    starts = searching.fine_starts[1::2] if other else searching.starts
    valves = _placed(_table(searching.bands, searching.jumps, starts), case.rows.u[0])
    stride = 2 if case.rows.count > _MANY_ROWS else 1
    found = []
    for look, rank, designs in zip(looks, ranking.of(law, valves), ranking.looks, strict=True):
        ways = []
        for i in first_apart(valves[:, 0], rank.cost, seeds, searching.apart):
            poles = COARSE[rank.process[i]]
            valve = Valve(float(valves[i, 0]), float(valves[i, 1]), float(valves[i, 2]), law)
            start = Found(float(rank.cost[i]), valve, poles, int(rank.late[i]))
            design = designs[int(poles.integrating)]
            ways.append(Descent(case, design, start, searching.wide, searching.lanes, stride))
        for way in ways:
            way.go_on(_TRIAL)
        ways.sort(key=lambda way: way.squares)
        for way in ways[:basins]:
            way.go_on(searching.generations - _TRIAL)
        ends = [way.found for way in ways]
        bands = np.array([end.valve.band for end in ends])
        squares = np.array([end.squares for end in ends])
        found += [(ends[i], look) for i in first_apart(bands, squares, basins, 0.05)]
    return found


def one_step_starts(
    case: Case,
    near: Hypothesis,
    nuisances: tuple[Nuisance, ...],
    past: int,
    beside: tuple[Nuisance, ...] = (),
) -> list[tuple[Valve, int, tuple[Nuisance, ...]]]:
    """The best valves of He's law by one-step errors, with their dead times and disturbances.

    So many samples of PV's past stand for process and noise. They are looked at with the
    ``nuisances``, and where there are any ``beside`` them with those as well. The dead time is one
    sample or more: with direct feed-through the regression may learn the controller, which answers
    PV within the same scan, instead of the process.
    """
    searching = case.settings.searching
    shifts = min(_SHIFTS, case.max_dead_time - 3)
    if shifts < 1:
        return []
    valves = _placed(_fine_table(searching), float(case.rows.u[0]))
    views = (nuisances, (*nuisances, *beside))[: 1 + bool(beside)]
    columns = [case.columns(known, near.stem, COARSE[0], near.dead_time) for known in views]
    more = columns[1][len(columns[0]) :] if beside else None
    both = OneStep(case.rows, columns[0], past, more)
    costs, lates = both.costs(valves, 1, shifts)
    return [
        (valve, late, known)
        for view, known in enumerate(views)
        for valve, late in _best_of_view(
            both.of_view(view), (valves, costs[:, view], lates[:, view]), shifts, searching
        )
    ]


def _best_of_view(
    ranking: OneStep, ranked: tuple[Array, Array, Index], shifts: int, searching: Searching
) -> list[tuple[Valve, int]]:
    """The best valves of one view with their dead times, looked around; see `look_around`."""
    for reach in _REACHES:
        # the best, and the best of each neighbourhood, so that not all stand in one valley
        tops = first_apart(ranked[0][:, 0], ranked[1], _TOPS, reach)
        tops = sorted({*tops, *first_apart(ranked[0][:, 0], ranked[1], _TOPS, -1.0)})
        if not tops:
            break
        ranked = look_around(ranking, ranked, tops, reach, shifts)
    valves, cost, late = ranked
    return [
        (Valve(float(valves[i, 0]), float(valves[i, 1]), float(valves[i, 2])), int(late[i]))
        for i in first_apart(valves[:, 0], cost, searching.basins[0], searching.apart)
    ]
