"""Other valves of nearly the same strokes, which lie in narrow valleys that no descent crosses.

A slip comes at a sample. Stick bands and slip jumps whose slips fall on the same samples form a
cell, in J often narrower than a hundredth of S; within a cell the cost is smooth, from cell to cell
it jumps. One-step errors rank thousands of valves of such a lattice in the time in which a
simulation costs a hundred.
"""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.algebra import stepped
from estimator.arrays import Array, Index
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.processes.poles import coefficients
from estimator.search.descent import moved_valves, refine_valve
from estimator.search.one_step import OneStep, look_around
from estimator.search.processes import settle
from estimator.valves.laws import LAWS

__all__ = ["sweep_valves"]

_LATTICE = np.linspace(-0.16, 0.16, 25), np.linspace(0.0, 1.0, 49)
"""Steps in log S, and slip jumps over S, that one-step errors rank. S reaches as far as it trades
against two samples of dead time where OP crosses it in 25: a sample later, both slips of a stroke
move OP's turn by a sample."""
_LINES = np.linspace(-0.03, 0.03, 5), np.linspace(0.0, 1.0, 17)
"""The same for simulation: where a stroke is one slip, J trades against the gain along a flat
valley, in which one-step errors tell little."""
_SIDES = np.array([-1.0, 0.0, 1.0])
"""The first slip stays where it is upwards, the stem before it stays, or the slip downwards."""
_JUMPS, _FIRST = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0]), np.linspace(-1.0, 1.0, 81)
"""Slip jumps over S, and first positions of the stem as shares of fS around OP's first sample, that
simulation tries with the stick band that was found. Of 17 pure slips of the tuning family six gain
18 to 380 nats by them: with every second position two do not, and more stick bands gain one."""
_BEHIND = 10.0
"""Nats by which one of another law may be behind before its process is fitted (tuning family: one
behind by 9 gains 25)."""
_CHOSEN = 16
"""Valves of that ranking that are simulated."""
_OTHER_JUMP, _OTHER_BAND = 0.07, 0.012
"""Slip jumps over S, and stick bands in logs, that differ by less end in one place."""
_REACHES = (0.005, 0.002, 0.0008)
"""How far one-step errors look around the best of that ranking, as shares of S: cells are narrower
than its meshes, and a valve beside the right cell ranks behind many wrong ones."""
_LOOKED_AROUND = 8
"""Valves of that ranking that they look around (tuning family: 4 lose valves, 16 find no more)."""
_REACH = 0.01
"""First reach of a refinement from a valve of the lattice, as a share of S: its own cell."""
_AGAIN = 3.0
"""Nats that a sweep must gain to be repeated from where it ended: a factor of twenty."""


def sweep_valves(case: Case, start: Hypothesis) -> Hypothesis:
    """The hypothesis of the likeliest valve nearby, ``start`` where none is likelier.

    All slip jumps are tried, with stick bands to a sixth around, and at the end all first positions
    of the stem. From a clearly better valve the sweep is repeated.
    """
    best = _swept_often(case, start)
    for _ in range(case.settings.searching.swept):
        other = _begun_elsewhere(case, best)
        if other.likelihood < best.likelihood + _AGAIN:
            break
        best = _swept_often(case, settle(case, other))
    return best


def _swept_often(case: Case, start: Hypothesis) -> Hypothesis:
    """The likeliest valve of sweeps in a row, each from where the last one ended."""
    best = start
    for turn in range(case.settings.searching.swept):
        # another valve's slips are earlier or later: the process, held until now, makes up for it
        found = settle(case, _swept(case, best, anywhere=turn == 0))
        gained = found.likelihood - best.likelihood
        best = found
        if gained < _AGAIN:
            break
    return best


def _swept(case: Case, start: Hypothesis, *, anywhere: bool) -> Hypothesis:
    """The likeliest of the start and of what the best valves around it are refined to.

    ``anywhere`` also tries the best of those from other first positions of the stem.
    """
    assert start.valve is not None
    valve = np.array(start.valve.numbers)
    lattice = _around(valve, *_LATTICE)
    columns = case.columns(start.nuisances, start.stem, start.poles, start.dead_time)
    ranking = OneStep(case.rows, columns)
    ranked = _best_by_one_step(case, ranking, start.dead_time, lattice)
    table = np.vstack([ranked, _around(valve, *_LINES)])
    costs = _simulated(case, start, table, start.valve.law)
    chosen = _best_apart(table, costs, case.settings.searching.swept, valve)
    own, first = start.valve.law, case.settings.searching.laws[0]
    if len(ranked) > 0 and 0 not in chosen:
        # the best one by one-step errors, whatever its simulation says with this process
        chosen.append(0)
    best = _likeliest(case, start, table[chosen], own)
    if anywhere:
        others = _from_anywhere(case, lattice)
        away = _best_by_one_step(case, ranking, start.dead_time, others)[:1]
        ranked = np.vstack([ranked[:1], away])
        best = _likeliest(case, best, away, own)
    if own != first and len(ranked) > 0 and best.likelihood < start.likelihood + _AGAIN:
        # one-step errors are those of the first law: it may lie in another valley there
        best = max(best, _likeliest(case, start, ranked, first), key=lambda one: one.likelihood)
    return best


def _likeliest(case: Case, start: Hypothesis, table: Array, law: str) -> Hypothesis:
    """The likeliest of the start and of what valves ``(m, 3)`` of a law are refined to."""
    best = start
    for row in table:
        valve = Valve(float(row[0]), float(row[1]), float(row[2]), law)
        at = case.fit(valve, start.poles, start.dead_time, start.nuisances, start.taps)
        found = refine_valve(case, at, _REACH, rival=best)
        if found.likelihood > best.likelihood:
            best = found
    return best


def _best_by_one_step(case: Case, ranking: OneStep, dead_time: int, lattice: Array) -> Array:
    """The best unlike valves ``(m, 3)`` by one-step errors, near the lattice too, best first."""
    shortest = max(1, dead_time - 1)
    shifts = min(3, case.max_dead_time + 1 - shortest)
    if shifts < 1:
        return lattice[:0]
    reversals = case.settings.searching.reversals
    cost, late = ranking.costs(lattice, shortest, shifts, reversals)
    ranked = lattice, cost[:, 0], late[:, 0]
    for reach in _REACHES:
        tops = _best_apart(ranked[0], ranked[1], _LOOKED_AROUND)
        if not tops:
            break
        ranked = look_around(ranking, ranked, tops, reach, case.max_dead_time, reversals)
    return ranked[0][_best_apart(ranked[0], ranked[1], _CHOSEN)]


def _around(valve: Array, bands: Array, jumps: Array) -> Array:
    """Valves ``(m, 3)`` with stick bands around one, all slip jumps, on each of the sides.

    On a side the start moves with what fS changes, against it, or not at all.
    """
    each = jumps.size * _SIDES.size
    steps = np.zeros((bands.size * each, 3))
    steps[:, 0] = np.repeat(bands, each)
    steps[:, 1] = np.tile(np.repeat(jumps, _SIDES.size), bands.size) - valve[1] / valve[0]
    table: Array = moved_valves(valve, steps)
    more = 0.5 * (table[:, 0] + table[:, 1] - valve[0] - valve[1])
    table[:, 2] += np.tile(_SIDES, bands.size * jumps.size) * more
    return table


def _from_anywhere(case: Case, lattice: Array) -> Array:
    """The valves of the lattice from other first positions of the stem, wherever it may have been.

    One valve may go two ways: from other first positions its stem slips at other samples all
    through the window.
    """
    shares = np.array(case.settings.searching.fine_starts)
    table = np.repeat(lattice[:: _SIDES.size], shares.size, axis=0)
    band = 0.5 * (table[:, 0] + table[:, 1])
    table[:, 2] = case.rows.u[0] + band * np.tile(shares, len(table) // shares.size)
    return table


def _begun_elsewhere(case: Case, start: Hypothesis) -> Hypothesis:
    """The likeliest valve of the same stick band whose stem began elsewhere, if any is likelier.

    With J at S the stem is at OP after every slip, and with a small J far behind it: which of them
    explains PV hangs on where the stem was at first, to a hundredth of S.
    """
    assert start.valve is not None
    band, own = start.valve.band, start.valve.jump / start.valve.band
    jump = band * np.append(_JUMPS, own).repeat(_FIRST.size)
    first = case.rows.u[0] + 0.5 * (band + jump) * np.tile(_FIRST, _JUMPS.size + 1)
    table = np.stack([np.full(first.size, band), jump, first], axis=1)
    best = start
    for law in dict.fromkeys((start.valve.law, *case.settings.searching.laws)):
        costs = _simulated(case, start, table, law)
        chosen = _best_apart(table, costs, 1)
        ahead = case.worth(np.array([start.squares]))[0] - case.worth(costs[chosen])
        # the process is that of the start's law: another one is refined though it is behind
        enough = _AGAIN if law == start.valve.law else -_BEHIND
        best = _likeliest(case, best, table[chosen][ahead > enough], law)
    return best


def _simulated(case: Case, start: Hypothesis, table: Array, law: str) -> Array:
    """Sums of squares ``(m,)`` that valves leave with the start's process and noise model."""
    design = case.design(start.nuisances, start.taps, start.stem, start.poles, start.dead_time)
    row = np.array([[start.poles.slow, start.poles.fast, start.poles.third]])
    processes = np.repeat(coefficients(start.poles.shape, row), len(table), axis=1)
    shortest = max(case.rows.soonest, start.dead_time - 1)
    count = min(3, case.max_dead_time + 1 - shortest)
    stems = LAWS[law](case.rows.u, table)
    costs = design.paired(stems, processes, shortest, count).min(axis=0)
    found: Array = np.where(case.tells(stems), costs, np.inf)
    return found


def _best_apart(table: Array, costs: Array, count: int, but: Array | None = None) -> list[int]:
    """Numbers of the cheapest valves that are unlike each other, and unlike one of them."""
    others = table[:0] if but is None else but[None]
    return [int(i) for i in _unlike(table, costs, count, others)]


@kernel
def _unlike(table: Array, costs: Array, count: int, but: Array) -> Index:
    """Numbers of the cheapest valves ``(m, 3)``, unlike each other and unlike those of ``but``."""
    jumps, bands = table[:, 1] / table[:, 0], np.log(table[:, 0])
    left = np.where(np.isfinite(costs), stepped(costs), np.inf)
    for i in range(but.shape[0]):
        _leave_out(left, jumps, bands, but[i, 1] / but[i, 0], math.log(but[i, 0]))
    found = np.empty(count, dtype=np.int64)
    some = 0
    while some < count and left.size > 0:
        top = left.argmin()
        if not np.isfinite(left[top]):
            break
        found[some] = top
        some += 1
        _leave_out(left, jumps, bands, jumps[top], bands[top])
    return found[:some]


@kernel
def _leave_out(left: Array, jumps: Array, bands: Array, jump: float, band: float) -> None:
    """Take out the valves, by J over S and log S, that end where one does."""
    for i in range(left.size):
        if abs(jumps[i] - jump) < _OTHER_JUMP and abs(bands[i] - band) < _OTHER_BAND:
            left[i] = np.inf
