"""The first look's costs: many valves, a few processes and dead times, several noise models.

What a stem has in common with PV needs no response: a sum of PV times the response is a sum of the
stem's moves times what PV, filtered backwards through noise model and process, holds from the move
to the end (the adjoint filter). A stem is a few slips and a few slides along OP, so that a valve
costs a few products at each dead time. Only the energy of a response needs the response itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Index, Mask
from estimator.hypotheses.hypothesis import Case
from estimator.hypotheses.linear_fit import Design
from estimator.lane_costs import NOTHING
from estimator.lane_energies import energies_of_stems
from estimator.processes.poles import COARSE
from estimator.valves.laws import LAWS

__all__ = ["Rank", "Ranking"]

_BLOCK = 32
"""Valves whose responses are computed side by side: their signals stay in the cache."""
_TOGETHER = 8
"""Columns of a table come in groups of so many, the last filled up with zeros: whole lanes."""
_ALONG = 1e-9
"""Difference between a step of the stem and one of OP (span 1) below which the stem follows OP."""


@dataclass(frozen=True, slots=True)
class Rank:
    """The least cost of every valve under one look, and where; all ``(m,)``."""

    cost: Array
    process: Index
    late: Index


class Ranking:
    """Several looks at many valves.

    Args:
        case: the window.
        looks: of each look, the design for processes that do not integrate, and for those that do.
        delays: dead times that are tried, rising.
    """

    def __init__(self, case: Case, looks: list[tuple[Design, Design]], delays: Index) -> None:
        self._case, self._delays = case, delays
        self.looks = looks
        self._noises, self._noise_of = _different([design.taps for design, _ in looks])
        self._tables = self._tables_of_looks()
        self._sliding = False
        """Whether the tables hold slides: laws without any need none."""

    def _design(self, pair: tuple[Design, Design], process: int) -> Design:
        return pair[int(COARSE[process].integrating)]

    def _tables_of_looks(self) -> list[list[Array]]:
        """Tables of `_tails` for each process of each look.

        They stand in one array: many smaller ones would be asked of the operating system anew for
        every window, page by page.
        """
        rows, late = 2 * self._case.rows.size, self._delays.size
        wide = [
            [_TOGETHER * -(-late * design.signals.shape[1] // _TOGETHER) for design in pair]
            for pair in self.looks
        ]
        store = np.empty(
            rows * sum(of_look[int(one.integrating)] for of_look in wide for one in COARSE)
        )
        tables: list[list[Array]] = []
        at = 0
        for pair, of_look in zip(self.looks, wide, strict=True):
            white = [_whiten_backwards(design.signals, design.taps) for design in pair]
            tables.append([])
            for poles in COARSE:
                kind = int(poles.integrating)
                size = rows * of_look[kind]
                table = store[at : at + size].reshape(rows, of_look[kind])
                _tails(white[kind], np.array(poles.coefficients), self._delays, table)
                tables[-1].append(table)
                at += size
        return tables

    def of(self, law: str, valves: Array) -> list[Rank]:
        """Rank valves ``(m, 3)`` of a law under each look."""
        rows = self._case.rows
        working = np.flatnonzero(self._work(law, valves))
        every, valves = len(valves), np.ascontiguousarray(valves[working])
        count, late = len(valves), self._delays.size
        energies = np.empty((self._noises[1].size, len(COARSE), late, count))
        moves = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
        for begin in range(0, count, _BLOCK):
            block = slice(begin, min(begin + _BLOCK, count))
            stems = LAWS[law](rows.u, valves[block])
            moves.append(_moves(stems, rows.u))
            for number, poles in enumerate(COARSE):
                energies[:, number, :, block] = energies_of_stems(
                    stems,
                    np.array(poles.coefficients),
                    self._noises,
                    rows.weight,
                    rows.first,
                    self._delays,
                )
        counts = np.concatenate([found[0] for found in moves])
        begins = np.append(0, np.cumsum(counts))
        places = np.concatenate([found[1] for found in moves])
        sizes = np.concatenate([found[2] for found in moves])
        alike = _alike(valves, begins, places, sizes)
        if not self._sliding and places.max(initial=0) >= rows.size:
            for tables in self._tables:
                for table in tables:
                    _add_slides(table, rows.u)
            self._sliding = True
        ranks = []
        for pair, tables, noise in zip(self.looks, self._tables, self._noise_of, strict=True):
            own = energies[noise]
            cost, process = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
            all_cost, all_process = np.full(every, np.inf), np.zeros(every, dtype=np.int64)
            all_late = np.full(every, self._delays[0])
            delay = np.zeros(count, dtype=np.int64)
            for number, table in enumerate(tables):
                design = self._design(pair, number)
                _rank(
                    begins,
                    places,
                    sizes,
                    alike,
                    table,
                    design.signals.shape[1],
                    own[number],
                    design.rest,
                    rows.sign,
                    number,
                    cost,
                    process,
                    delay,
                )
            all_cost[working], all_process[working] = cost, process
            all_late[working] = self._delays[delay]
            ranks.append(Rank(all_cost, all_process, all_late))
        return ranks

    def _work(self, law: str, valves: Array) -> Mask:
        """Which stems of valves ``(m, 3)`` work like a valve, ``(m,)``: the others cost nothing."""
        found = np.zeros(len(valves), dtype=np.bool_)
        for begin in range(0, len(valves), _BLOCK):
            some = np.ascontiguousarray(valves[begin : begin + _BLOCK])
            found[begin : begin + _BLOCK] = self._case.tells(LAWS[law](self._case.rows.u, some))
        return found


def _different(taps: list[Array]) -> tuple[tuple[Array, Index], list[int]]:
    """Different noise models, one a row and their orders; and which of them each of many is."""
    found: list[Array] = []
    numbers = []
    for one in taps:
        alike = [i for i, other in enumerate(found) if np.array_equal(one, other)]
        numbers.append(alike[0] if alike else len(found))
        if not alike:
            found.append(one)
    orders = np.array([one.size for one in found])
    table = np.zeros((len(found), orders.max()))
    for row, one in zip(table, found, strict=True):
        row[: one.size] = one
    return (table, orders), numbers


@kernel
def _whiten_backwards(signals: Array, taps: Array) -> Array:
    """Signals ``(n, m)`` through the adjoint of a noise model."""
    n, m = signals.shape
    white = signals.copy()
    for i in range(taps.size):
        tap = taps[i]
        for k in range(n - 1 - i):
            for c in range(m):
                white[k, c] -= tap * signals[k + 1 + i, c]
    return white


@kernel
def _tails(white: Array, process: Array, delays: Index, out: Array) -> None:
    """Sums of filtered signals from every row to the end, into ``out`` ``(2 n, D m)`` or wider.

    Signals ``(n, m)``, whitened backwards, go backwards through the process, which has no third
    lag. Row ``k`` holds, for each of the ``delays``, what a stem that steps by one at row ``k`` has
    in common with each signal; row ``n + k`` has room for a slide (`_add_slides`).
    """
    n, m = white.shape
    late = delays.size
    tails = np.zeros((n + delays[late - 1] + 1, m))
    v1, v2 = np.zeros(m), np.zeros(m)
    c1, c2, gain = process[0], process[1], process[3]
    for k in range(n - 1, -1, -1):
        for c in range(m):
            v = c1 * v1[c] + c2 * v2[c] + white[k, c]
            v2[c] = v1[c]
            v1[c] = v
            tails[k, c] = tails[k + 1, c] + gain * v
    for k in range(n):
        out[k, late * m :] = 0.0
        for d in range(late):
            for c in range(m):
                out[k, d * m + c] = tails[k + delays[d], c]


@innermost
def _add_row(now: Array, before: Array, factor: float, row: Array) -> None:
    """The row before and a factor times another."""
    for i in range(now.size):
        now[i] = before[i] + factor * row[i]


@innermost
def _add_four(
    sums: Array,
    s: tuple[float, float, float, float],
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
) -> None:
    """Add four rows, each times a factor."""
    for c in range(sums.size):
        sums[c] = sums[c] + s[0] * r0[c] + s[1] * r1[c] + s[2] * r2[c] + s[3] * r3[c]


@kernel
def _add_slides(table: Array, op: Array) -> None:
    """Row ``n + k``: what a stem that follows OP from the first row to row ``k`` has in common."""
    n = op.size
    table[n] = 0.0
    for k in range(1, n):
        step = op[k] - op[k - 1]
        _add_row(table[n + k], table[n + k - 1], step, table[k])


@kernel
def _moves(stems: Array, op: Array) -> tuple[Index, Index, Array]:
    """Describe the moves of stems, shape ``(n, L)``, as sums of rows of `_tails`.

    Returns the number of rows for each stem, the rows of all stems one after the other, and a
    factor for each row. A slip takes one row. A slide along OP takes two: OP's travel up to the
    slide's end, less its travel before the slide's begin.
    """
    n, lanes = stems.shape
    counts = np.zeros(lanes, dtype=np.int64)
    places = np.empty(n * lanes, dtype=np.int64)
    sizes = np.empty(n * lanes)
    at = 0
    for j in range(lanes):
        begin, k = at, 1
        while k < n:
            step = stems[k, j] - stems[k - 1, j]
            if step == 0.0:
                k += 1
                continue
            end = k
            while (
                end < n and abs(stems[end, j] - stems[end - 1, j] - op[end] + op[end - 1]) < _ALONG
            ):
                end += 1
            if end > k + 2:
                places[at], sizes[at] = n + end - 1, 1.0
                places[at + 1], sizes[at + 1] = n + k - 1, -1.0
                at += 2
                k = end
            else:
                places[at], sizes[at] = k, step
                at += 1
                k += 1
        counts[j] = at - begin
    return counts, places[:at].copy(), sizes[:at].copy()


@kernel
def _alike(valves: Array, begins: Index, places: Index, sizes: Array) -> Index:
    """How many last moves a valve shares with the one before it that shares none; ``(m,)``.

    A slip ends where OP and the friction say, wherever the stem was: valves of one S and J, which
    differ in their start only, soon move alike. The first of each S and J shares none.
    """
    alike = np.zeros(begins.size - 1, dtype=np.int64)
    first = 0
    for v in range(1, alike.size):
        if valves[v, 0] != valves[first, 0] or valves[v, 1] != valves[first, 1]:
            first = v
            continue
        i, j = begins[v + 1] - 1, begins[first + 1] - 1
        while (
            i >= begins[v]
            and j >= begins[first]
            and places[i] == places[j]
            and sizes[i] == sizes[j]
        ):
            i -= 1
            j -= 1
        alike[v] = begins[v + 1] - 1 - i
        if alike[v] == 0:
            first = v
    return alike


@kernel
def _add_moves(
    begin: int, end: int, factor: float, places: Index, sizes: Array, table: Array, sums: Array
) -> None:
    """Add ``factor`` times what the moves from ``begin`` to ``end`` have in common with signals."""
    i = begin
    while i + 4 <= end:
        s0, s1 = factor * sizes[i], factor * sizes[i + 1]
        s2, s3 = factor * sizes[i + 2], factor * sizes[i + 3]
        r0, r1 = table[places[i]], table[places[i + 1]]
        r2, r3 = table[places[i + 2]], table[places[i + 3]]
        _add_four(sums, (s0, s1, s2, s3), r0, r1, r2, r3)
        i += 4
    while i < end:
        size, row = factor * sizes[i], table[places[i]]
        for c in range(sums.size):
            sums[c] += size * row[c]
        i += 1


@kernel
def _rank(
    begins: Index,
    places: Index,
    sizes: Array,
    alike: Index,
    table: Array,
    columns: int,
    energies: Array,
    rest: float,
    sign: float,
    number: int,
    cost: Array,
    process: Index,
    delay: Index,
) -> None:
    """Costs of all valves with one process under one look; what is less is kept in place.

    ``table`` is that of `_tails` with so many ``columns`` a dead time, ``alike`` that of `_alike`,
    ``energies`` ``(D, m)``. A gain of the wrong ``sign`` counts as none.
    """
    late, count = energies.shape
    wide = table.shape[1]
    sums, known = np.empty(wide), np.zeros(wide)
    first = 0
    for v in range(count):
        same = alike[v]
        if same == 0:
            sums[:] = 0.0
            _add_moves(begins[v], begins[v + 1], 1.0, places, sizes, table, sums)
            first = v
            known[:] = sums
        else:
            sums[:] = known
            end = begins[first + 1] - same
            _add_moves(begins[first], end, -1.0, places, sizes, table, sums)
            end = begins[v + 1] - same
            _add_moves(begins[v], end, 1.0, places, sizes, table, sums)
        for d in range(late):
            energy, found = energies[d, v], rest
            with_pv = sums[d * columns]
            for c in range(1, columns):
                energy -= sums[d * columns + c] * sums[d * columns + c]
            if energy > NOTHING * energies[d, v] and sign * with_pv >= 0.0:
                found = rest - with_pv * with_pv / energy
            if found < cost[v]:
                cost[v], process[v], delay[v] = found, number, d
