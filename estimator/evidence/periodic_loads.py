"""A triangular or rectangular load, looked for beside a healthy valve.

Seen from OP and PV these are the closest things to a sticky valve: OP answers a triangular one with
lines, PV with arcs; a rectangular one moves PV as the jumps of a stem do. A process that was fitted
without it is wrong, so that it is looked for with several.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, project_out
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, likelier
from estimator.hypotheses.linear_fit import left_of_pv
from estimator.hypotheses.nuisances import spectral_peaks
from estimator.hypotheses.periodic_load import PeriodicLoad, cycle_of, periodic_response
from estimator.processes.poles import SHAPE_NUMBERS, Poles, Shape, coefficients_of
from estimator.search.processes import polish

__all__ = ["fit_entering_load", "fit_periodic_load"]

_FEWEST_CYCLES = 2.0
"""Cycles in the window below which it is not looked for: what is not seen twice fits the strokes of
any sticky valve. From three on, healthy valves under two to three cycles are accused (tuning
family, cut to so many: 11 of 54, and one at two; of 75 sticky valves one more is missed, and four
are uncertain)."""
_PERIODS = 2
"""Periods that are tried: that of a wave which pays, then that of PV or OP."""
_SQUARE_PERIODS = 1
"""The same of a rectangular load: PV's own, or else that of a wave which pays. What was taken for
another wave is often one of its harmonics."""
_SAME_PERIOD = 0.3
"""Cycles within which two periods are one: the search moves as far."""
_BEGINS = 16
"""Begins of the wave, evenly over a cycle, from which the search starts: half of them where it
rises as long as it falls, because the size may be negative."""
_RISES = (0.25, 0.5)
"""Rises from which it starts; with the size negative the first is 0.75."""
_LEAST_RISE = 0.03
"""Shortest rise, and fall, in cycles: a saw-tooth."""
_STEPS = np.array([0.1, 0.05, 0.02, 0.01])
"""Steps in cycles, of which begin and rise take `_SHARES`; each until it gains no more."""
_ROUGHLY = _STEPS[:1]
"""The same where only processes are compared."""
_LAGS, _DEAD_TIMES = (3.0, 8.0, 20.0), (0, 4, 8, 12)
"""Lags and dead times, in samples, with which it is looked for beside those of the starts."""
_OWN_LAGS = np.array([0.0, 1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0, 40.0, 63.0, 100.0])
"""Lags in samples through which a load may enter of its own; none is a load on PV itself."""
_EVERY = 3
"""Of these, every third is started from; the search then moves to those beside."""
_SHARES = np.array([1.0, 0.4, 1.0])
_MOST_MOVES = 6
"""Moves with one step."""
_TURNS = 3
"""Load and process are fitted in turn, at most so often."""
_GAINED = 0.5
"""Nats of a turn below which it was the last."""
_TIE = 1e-9
"""Relative gain below which two sums of squares are the same: rounding decides nothing."""


def fit_periodic_load(
    case: Case, starts: tuple[Hypothesis, ...], *, square: bool = False
) -> Hypothesis | None:
    """The healthy valve with a triangular load, the likeliest from some processes and periods.

    With ``square`` the load is rectangular. ``starts`` are hypotheses whose processes and waves it
    begins from. None where nothing swings.
    """
    best: Hypothesis | None = None
    for cycles in _periods(case, starts, square):
        # what was fitted without the wave may have another shape and dead time altogether
        for start in (*starts, _lag_beside_wave(case, starts[0], cycles, square)):
            found = _fitted(case, start, cycles, square)
            best = found if best is None else likelier(best, found)
    return best


def fit_entering_load(case: Case, start: Hypothesis) -> Hypothesis | None:
    """The healthy valve with a triangular load that enters through a lag of its own, or on PV.

    At PV's own period, from the process of ``start``. None where PV does not swing so many cycles.
    """
    cycles = case.own_cycles
    if cycles is None or cycles < _FEWEST_CYCLES:
        return None
    return _fitted(case, start, cycles, square=False, own=True)


def _lag_beside_wave(case: Case, near: Hypothesis, cycles: float, square: bool) -> Hypothesis:
    """The healthy valve with the lag, of a few, that beside a roughly placed wave leaves least."""
    best: Hypothesis | None = None
    for slow in _LAGS:
        for late in _DEAD_TIMES:
            dead_time = max(late, case.rows.soonest)
            if dead_time > case.max_dead_time:
                continue
            at = replace(
                near,
                valve=None,
                stem=case.rows.u,
                poles=Poles(Shape.LAGS, slow),
                dead_time=dead_time,
            )
            load = _best_load(case, at, cycles, square, _ROUGHLY)
            found = case.fit(None, at.poles, dead_time, (load,), near.taps)
            best = found if best is None else likelier(best, found)
    assert best is not None
    return best


def _periods(case: Case, starts: tuple[Hypothesis, ...], square: bool) -> list[float]:
    """Cycles in the window that are tried."""

    def known() -> Iterator[float]:
        if square and case.own_cycles is not None:
            yield case.own_cycles
        for one in starts:
            yield from (wave.cycles for wave in one.waves)
        if case.own_cycles is not None:
            yield case.own_cycles
        yield from spectral_peaks(case.rows.u * case.rows.weight, 1)

    found: list[float] = []
    for cycles in known():
        is_new = all(abs(cycles - one) > _SAME_PERIOD for one in found)
        if cycles >= _FEWEST_CYCLES and is_new:
            found.append(cycles)
    return found[: _SQUARE_PERIODS if square else _PERIODS]


def _fitted(
    case: Case, start: Hypothesis, cycles: float, square: bool, own: bool = False
) -> Hypothesis:
    """Load and process fitted in turn from the process of one hypothesis."""
    at = replace(start, valve=None, stem=case.rows.u)
    best: Hypothesis | None = None
    for turn in range(_TURNS):
        load = _best_load(case, at, cycles, square, own=own)
        found = polish(case, None, at, (load,), at.taps, wide=turn == 0)
        if best is not None and found.likelihood <= best.likelihood + _GAINED:
            break
        best, at, cycles = found, found, load.cycles
    assert best is not None
    return best


def _best_load(
    case: Case,
    of: Hypothesis,
    cycles: float,
    square: bool,
    steps: Array = _STEPS,
    own: bool = False,
) -> PeriodicLoad:
    """The load that takes most from PV with this process and noise model."""
    rows = case.rows
    columns = case.columns((), of.stem, of.poles, of.dead_time)
    response = of.poles.response(of.stem)
    basis, left = left_of_pv(rows, response, of.dead_time, columns, of.taps)
    lags, before = np.zeros(1), 0
    entries = np.array(of.poles.coefficients)[:, None]
    if own:
        lags, before = _OWN_LAGS, cycle_of(cycles, rows.size)
        entries = coefficients_of(SHAPE_NUMBERS[Shape.LAGS], _lag_table())
    wave, entry = _best_wave(
        cycles, entries, lags, of.taps, rows.weight, basis, left, steps, square, before
    )
    cycles, begin, rise = (float(one) for one in wave)
    through = Poles(Shape.LAGS, float(lags[entry])) if own else of.poles
    return PeriodicLoad(cycles, begin, rise, through, square, own)


def _lag_table() -> Array:
    """The own lags as processes, ``(m, 3)``."""
    table = np.zeros((_OWN_LAGS.size, 3))
    table[:, 0] = _OWN_LAGS
    return table


@kernel
def _best_wave(
    cycles: float,
    entries: Array,
    lags: Array,
    taps: Array,
    weight: Array,
    basis: Array,
    left: Array,
    steps: Array,
    square: bool,
    before: int,
) -> tuple[Array, int]:
    """Cycles, begin and rise ``(3,)`` of the wave that takes most, and its entry; see `_taken`.

    ``entries`` ``(4, m)`` are the processes that it may go through; where they are several, they
    are the ``lags`` ``(m,)``.
    """
    best, at, most = np.array([cycles, 0.0, 0.5]), 0, 0.0
    for entry in range(0, lags.size, _EVERY):
        for rise in _RISES:
            for i in range(_BEGINS // 2 if rise == 0.5 else _BEGINS):
                tried = np.array([cycles, i / _BEGINS, rise])
                more = _taken(tried, entries[:, entry], taps, weight, basis, left, square, before)
                if more > most * (1.0 + _TIE):
                    best, at, most = tried, entry, more
    for step in steps:
        for _ in range(_MOST_MOVES):
            reached = most
            for c in range(3):
                for side in (-1.0, 1.0):
                    tried = best.copy()
                    tried[c] += side * step * _SHARES[c]
                    if c == 0:
                        # the middle of the window keeps its place in the cycle
                        tried[1] -= 0.5 * side * step
                    tried[2] = min(max(tried[2], _LEAST_RISE), 1.0 - _LEAST_RISE)
                    more = _taken(tried, entries[:, at], taps, weight, basis, left, square, before)
                    if more > most * (1.0 + _TIE):
                        best, most = tried, more
            for entry in (at - 1, at + 1):
                if 0 <= entry < lags.size:
                    tried = best.copy()
                    # what the wave is late behind a longer lag, it begins earlier
                    angle = 2.0 * math.pi * best[0] / left.size
                    late = math.atan(angle * lags[entry]) - math.atan(angle * lags[at])
                    tried[1] += late / (2.0 * math.pi)
                    more = _taken(
                        tried, entries[:, entry], taps, weight, basis, left, square, before
                    )
                    if more > most * (1.0 + _TIE):
                        best, at, most = tried, entry, more
            if most == reached:
                break
    return best, at


@kernel
def _taken(
    wave: Array,
    process: Array,
    taps: Array,
    weight: Array,
    basis: Array,
    left: Array,
    square: bool,
    before: int,
) -> float:
    """Sum of squares that a load takes away.

    Of what an orthonormal ``basis`` ``(m, n)`` leaves of PV, ``left`` ``(n,)``, both under the
    noise model of ``taps``.
    """
    signal = np.empty((1, left.size))
    through = process[0], process[1], process[2], process[3]
    shape = wave[0], wave[1], wave[2]
    signal[0] = periodic_response(shape, through, left.size, square, before)
    mine = project_out(filter_rows(signal, taps, weight)[0], basis)
    size = dot(mine, mine)
    return dot(mine, left) ** 2 / size if size > 0.0 else 0.0
