"""A load that swings unevenly, looked for beside a valve.

Where it turns is first told by a load of steps and lines (`piecewise_loads`), or by the cycles of
OP and PV (`cycle_turns`), with several processes; then turns, shape and process move together
(Gauss-Newton), then noise and dead time, in turn. See `estimator.hypotheses.uneven_wave` for the
wave.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from estimator.arrays import Array
from estimator.evidence.cycle_turns import cycles_of, turns_in_cycles
from estimator.evidence.outlined_turns import turns_of
from estimator.evidence.piecewise_loads import outline_load, without_load
from estimator.evidence.wave_fits import Wave, fit_wave
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import DRIFT_AND_NOISE
from estimator.hypotheses.uneven_wave import UnevenWave
from estimator.processes.poles import Poles, Shape
from estimator.search.processes import polish

__all__ = ["find_uneven_wave", "find_wave_in_cycles", "refit_uneven_wave"]

_OUTLINED = 4.0
"""Nats that a corner of the outline must gain: about what a turn costs."""
_FOLLOWED, _BENT = 3, 2
"""Of all starts, those that are fitted in turn, and of these those that are bent."""
_AT_VALVE = (
    (Poles(Shape.LAGS, 20.0), 6),
    (Poles(Shape.LAGS, 3.0), 6),
    (Poles(Shape.LAGS, 16.0, 6.0), 4),
    (Poles(Shape.INTEGRATING, 0.0, 3.0), 3),
)
"""Processes, with dead times in samples, with which a wave at the valve is looked for."""
_AT_PV = (
    (Poles(Shape.LAGS, 8.0), 6),
    (Poles(Shape.LAGS, 25.0), 6),
    (Poles(Shape.LAGS, 5.0), 2),
)
"""The same for a wave on PV."""
_HOPE, _STRAIGHT = 110.0, 65.0
"""Nats that an outlined wave may still gain, and one that is fitted in turn and has no bends. It
saves time: of 26 simulated waves that become the likeliest all but two are that near, the others
within 98 and 60."""
_FOLLOWED_IN_CYCLES, _HOPE_IN_CYCLES = 2, 400.0
"""The same two of waves that the cycles of OP and PV tell. Their turns are read off noise, and the
fit moves them far: of 32 simulated ones that become the likeliest, from 370 nats below."""
_OWN_LAG = 3.0
"""Samples of the lag of its own with which a wave that enters within the process begins."""
_ALIKE = 1.0
"""Nats within which two starts lead to the same wave."""
_BENDS = (0, 2)
"""Sines of a rise's bend: none is a line, two make it a sine's or a lag's."""
_TURNS, _LONG = 3, 8
"""Wave and noise are fitted in turn so often at most, and the likeliest once more."""
_ROUNDS = 6
"""Steps of a fit of the wave with one spread of its turns."""
_GAINED = 0.5
"""Nats of a turn below which it was the last."""


def find_uneven_wave(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
    """The healthy valve with the likeliest load that swings unevenly.

    It is looked for with some processes, not with that of the sticky valve: beside that the load is
    what the stem does apart from OP. Its noise is that of the sticky valve, or a drift. A drift
    takes part of the wave to itself, and the wave that is found beside it leaves a drift again; but
    the sticky valve explains the wave, and leaves about the noise. None where none is found, or has
    no hope to become as likely as ``least``.
    """
    return _likeliest(case, _starts(case, sticky), least)


def find_wave_in_cycles(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
    """The same, of waves of straight lines that the cycles of OP and PV tell."""
    cycles = cycles_of(case)
    if cycles is None:
        return None
    groups: dict[tuple[bool, int], list[tuple[float, Hypothesis, bool, Wave]]] = {}
    for start, at_valve in _starts(case, sticky):
        group = groups.setdefault((at_valve, start.taps.size), [])
        for times, heights in turns_in_cycles(case, start, at_valve, cycles):
            group.append(_tried(case, start, at_valve, times, heights))
    ends = []
    for group in groups.values():
        ends += _followed(case, group, -math.inf, _FOLLOWED_IN_CYCLES)
    ends.sort(key=lambda one: -round(one[0].likelihood, 6))
    found = []
    for start, wave, at_valve in ends[:_BENT]:
        if start.likelihood > least - _HOPE_IN_CYCLES:
            # noise and process that are fitted once more may end where it is less likely
            found.append(start)
            for lag in (None, _OWN_LAG):
                own = replace(wave, lag=lag)
                found.append(_in_turn(case, start, start.taps, at_valve, own, _LONG)[0])
    return max(found, key=lambda one: one.likelihood, default=None)


def _starts(case: Case, sticky: Hypothesis) -> Iterator[tuple[Hypothesis, bool]]:
    """Processes and noise models beside which a wave is looked for, at the valve or at PV."""
    healthy = replace(sticky, valve=None, stem=case.rows.u, nuisances=())
    for taps in (sticky.taps, DRIFT_AND_NOISE):
        for processes, at_valve in ((_AT_VALVE, True), (_AT_PV, False)):
            for poles, dead_time in processes:
                if dead_time <= case.max_dead_time:
                    yield replace(healthy, poles=poles, dead_time=dead_time, taps=taps), at_valve


def refit_uneven_wave(
    case: Case, of: Hypothesis, known: Hypothesis, least: float
) -> Hypothesis | None:
    """The hypothesis with the likeliest such load in place of any other of a course of its own.

    It keeps its valve and what else is beside it, and begins from its process. The turns of the
    wave that is ``known`` beside another are tried too. None as above.
    """
    return _likeliest(case, [(of, True), (of, False)], least, tuple(_known_turns(known)))


def _likeliest(
    case: Case,
    starts: Iterable[tuple[Hypothesis, bool]],
    least: float,
    known: tuple[tuple[Array, Array], ...] = (),
) -> Hypothesis | None:
    """The likeliest wave from processes beside which it enters at the valve, or at PV."""
    tried = []
    for start, at_valve in starts:
        outline = outline_load(case, start, at_valve, _OUTLINED)
        for times, heights in (*turns_of(outline), *known):
            tried.append(_tried(case, start, at_valve, times, heights))
    ends = _followed(case, tried, least - _HOPE, _FOLLOWED)
    found = []
    for start, wave, at_valve in ends[:_BENT]:
        if start.likelihood < least - _STRAIGHT:
            break
        found.append(start)
        for count in _BENDS:
            bent = replace(wave, bends=np.zeros((2, count)))
            found.append(_in_turn(case, start, start.taps, at_valve, bent, _LONG)[0])
    return max(found, key=lambda one: one.likelihood, default=None)


def _tried(
    case: Case, start: Hypothesis, at_valve: bool, times: Array, heights: Array
) -> tuple[float, Hypothesis, bool, Wave]:
    """A wave of straight lines fitted beside one process, and how likely it makes the window."""
    wave = Wave(times, heights, np.zeros((2, 0)), start.poles, 0.0, 0.0)
    wave = fit_wave(case, start, start.taps, at_valve, wave, rounds=_ROUNDS, spreads=1)
    others, sticky = without_load(start), start.valve is not None
    price = case.price(wave.poles, others, start.taps, sticky) + wave.price
    return case.log_likelihood(wave.squares) - price, start, at_valve, wave


def _followed(
    case: Case, tried: list[tuple[float, Hypothesis, bool, Wave]], least: float, most: int
) -> list[tuple[Hypothesis, Wave, bool]]:
    """The likeliest unlike waves, at least so likely, with wave and noise fitted in turn."""
    followed: list[tuple[float, bool]] = []
    ends: list[tuple[Hypothesis, Wave, bool]] = []
    for worth, start, at_valve, wave in sorted(tried, key=lambda one: -round(one[0], 6)):
        if worth < least or len(followed) == most:
            break
        if any(way == at_valve and abs(worth - one) < _ALIKE for one, way in followed):
            continue
        followed.append((worth, at_valve))
        ends.append((*_in_turn(case, start, start.taps, at_valve, wave, _TURNS), at_valve))
    return sorted(ends, key=lambda one: -round(one[0].likelihood, 6))


def _in_turn(
    case: Case, start: Hypothesis, taps: Array, at_valve: bool, wave: Wave, most: int
) -> tuple[Hypothesis, Wave]:
    """Wave with process, then noise and dead time, in turn."""
    at, best = start, None
    for _ in range(most):
        found = fit_wave(case, at, taps, at_valve, wave, rounds=_ROUNDS, spreads=2)
        nuisances = (*without_load(at), found.nuisance(at_valve))
        one = polish(
            case, at.valve, (found.poles, at.dead_time), nuisances, taps, passes=2, wide=False
        )
        gained = math.inf if best is None else one.likelihood - best[0].likelihood
        if gained > 0.0:
            best = one, found
        if gained < _GAINED:
            break
        at, wave, taps = one, found, one.taps
    assert best is not None
    return best


def _known_turns(of: Hypothesis) -> Iterator[tuple[Array, Array]]:
    """Turns of the wave that it has already."""
    for one in of.nuisances:
        if isinstance(one, UnevenWave):
            yield np.array(one.times), np.array(one.heights)
