"""Turns of an uneven wave from the cycles that OP or PV go through.

A load of steps and lines (`estimator.evidence.outlined_turns`) shows the turns of a slow wave with
little noise. Of a fast one no corner pays alone, and the whole wave would. But what it does to OP
and PV has its cycles, each as long as the wave's own: at which share of a cycle the wave begins to
rise, and for how long, is all that is left to find, and of all such waves the one that takes most
from PV is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, project_out
from estimator.arrays import Array
from estimator.evidence.outlined_turns import FEWEST_TURNS, turning_rows
from estimator.evidence.piecewise_loads import without_load
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import left_of_pv
from estimator.hypotheses.piecewise_load import NO_PROCESS
from estimator.hypotheses.uneven_wave import through_process

__all__ = ["cycles_of", "turns_in_cycles"]

_SMOOTHED = 8
"""Share of a cycle over which a signal is averaged before its turns are read: one over this."""
_UNEVEN = 0.25
"""Deviation of the cycles' lengths over their mean at most: twice what a wave's may have, because
noise moves the turns that are read."""
_BEGINS = 16
"""Shares of a cycle at which the wave may begin to rise, evenly."""
_RISES = np.array([0.2, 0.35, 0.5, 0.65, 0.8]), np.array([0.07, 0.93])
"""Shares of a cycle for which it may rise, of triangles and of saw-teeth; a fit moves them. What
the better one of a kind takes before a fit does not tell which kind is better after it."""
_MOST_TURNS = 160
"""Turns of a wave that is looked for so: a fit's work grows with the square of their number."""
_TIE = 1e-9
"""Relative gain below which two waves are as good: rounding decides nothing."""


def cycles_of(case: Case) -> Array | None:
    """Begins of cycles in samples, from before the window until after it.

    As OP tells, which a controller moves with the load, or else PV. None where the cycles of both
    are few, or far from alike.
    """
    for signal in (case.rows.u, case.rows.y):
        found = _cycles(signal)
        if found is not None:
            return found
    return None


def _cycles(signal: Array) -> Array | None:
    turns = turning_rows(signal, _deviation(signal))
    if turns.size < FEWEST_TURNS:
        return None
    width = int(2.0 * float(np.median(np.diff(turns))) / _SMOOTHED)
    if width > 1:
        signal = _averaged(signal, width)
        turns = turning_rows(signal, _deviation(signal))
        if turns.size < FEWEST_TURNS:
            return None
    begins = turns[::2].astype(np.float64)
    lengths = np.diff(begins)
    if float(lengths.std()) > _UNEVEN * float(lengths.mean()):
        return None
    usual, n = float(np.median(lengths)), signal.size
    # one cycle more at each end: a wave may begin anywhere in its cycle
    before = math.ceil(begins[0] / usual) + 2
    after = math.ceil((n - begins[-1]) / usual) + 2
    return np.concatenate(
        [
            begins[0] - usual * np.arange(before, 0, -1),
            begins,
            begins[-1] + usual * np.arange(1, after + 1),
        ]
    )


def _deviation(signal: Array) -> float:
    about = signal - signal.mean()
    return math.sqrt(dot(about, about) / signal.size)


@kernel
def _averaged(signal: Array, width: int) -> Array:
    """Means of ``width`` samples around each, of fewer at the ends."""
    n, half = signal.size, width // 2
    out = np.empty(n)
    for k in range(n):
        low, high = max(k - half, 0), min(k + half + 1, n)
        out[k] = signal[low:high].sum() / (high - low)
    return out


def turns_in_cycles(
    case: Case, start: Hypothesis, at_valve: bool, cycles: Array
) -> Iterator[tuple[Array, Array]]:
    """Times and heights of the turns of waves that take most from PV, as `UnevenWave` has them.

    They go through the ``cycles``, beside a start's process and noise, and enter at the valve or
    at PV: the best triangle and the best saw-tooth, but for those that take nothing or have too
    many turns.
    """
    rows = case.rows
    taps = np.ascontiguousarray(start.taps)
    columns = case.columns(without_load(start), start.stem, start.poles, start.dead_time)
    response = start.poles.response(start.stem)
    basis, left = left_of_pv(rows, response, start.dead_time, columns, taps)
    process = start.poles.coefficients if at_valve else NO_PROCESS
    order = np.arange(cycles.size, dtype=np.float64)
    phase = np.interp(np.arange(rows.size, dtype=np.float64), cycles, order)
    for rises in _RISES:
        begin, rise, size = _best_wave(
            phase, _BEGINS, rises, process, taps, rows.weight, basis, left
        )
        bottoms = order[:-1] + begin
        at = np.stack([bottoms, bottoms + rise], axis=1).ravel()
        times = np.interp(at[at < order[-1]], order, cycles)
        heights = np.where(np.arange(times.size) % 2 == 0, -size, size)
        # from the last turn before the window to the first behind it
        first = int(np.searchsorted(times, 0.0, side="right")) - 1
        last = int(np.searchsorted(times, rows.size - 1.0, side="left")) + 1
        if size != 0.0 and last - first <= _MOST_TURNS:
            yield times[first:last], heights[first:last]


@kernel
def _best_wave(
    phase: Array,
    begins: int,
    rises: Array,
    process: tuple[float, float, float, float],
    taps: Array,
    weight: Array,
    basis: Array,
    left: Array,
) -> tuple[float, float, float]:
    """Begin and rise, in cycles, of the wave that takes most, and its size; 0 where none does.

    Of what an orthonormal ``basis`` ``(m, n)`` leaves of PV, ``left`` ``(n,)``, both under the
    noise model of ``taps``; ``phase`` ``(n,)`` counts cycles.
    """
    n = phase.size
    load = np.empty((1, n))
    found, most = (0.0, 0.5, 0.0), 0.0
    for rise in rises:
        for i in range(begins):
            begin = i / begins
            for k in range(n):
                x = phase[k] - begin
                x -= math.floor(x)
                load[0, k] = (
                    2.0 * x / rise - 1.0 if x < rise else 1.0 - 2.0 * (x - rise) / (1.0 - rise)
                )
            wave = filter_rows(through_process(load, process), taps, weight)
            mine = project_out(wave[0], basis)
            size = dot(mine, mine)
            if size > 0.0:
                common = dot(mine, left)
                if common * common / size > most * (1.0 + _TIE):
                    found, most = (begin, rise, common / size), common * common / size
    return found
