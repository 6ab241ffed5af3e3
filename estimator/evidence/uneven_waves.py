"""A load that swings unevenly, looked for beside a valve.

Where it turns is first told by a load of steps and lines (`piecewise_loads`), with several
processes; then turns, shape and process move together (Gauss-Newton), then noise and dead time, in
turn. See `estimator.hypotheses.uneven_wave` for the wave.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from estimator.arrays import Array
from estimator.evidence.outlined_turns import turns_of
from estimator.evidence.piecewise_loads import outline_load, without_load
from estimator.evidence.wave_fits import Wave, fit_wave
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import DRIFT_AND_NOISE
from estimator.hypotheses.uneven_wave import UnevenWave
from estimator.processes.poles import Poles, Shape
from estimator.search.processes import polish

__all__ = ["find_uneven_wave", "refit_uneven_wave"]

_OUTLINED = 4.0
"""Nats that a corner of the outline must gain: about what a turn costs."""
_FOLLOWED = 2
"""Of all starts, those that are fitted in turn."""
_AT_VALVE, _AT_PV = ((20.0, 6), (3.0, 6)), ((8.0, 6),)
"""Lags and dead times, in samples, with which a wave at the valve is looked for, and one on PV."""
_HOPE, _BENT = 150.0, 60.0
"""Nats that an outlined wave may still gain, and one that has no bends. It saves time: of a dozen
simulated waves some gain up to 190. The second is a guess."""
_ALIKE = 1.0
"""Nats within which two starts lead to the same wave."""
_BENDS = (0, 2)
"""Sines of a rise's bend: none is a line, two make it a sine's or a lag's."""
_TURNS, _LONG = 3, 8
"""Wave and noise are fitted in turn so often at most, and the likeliest once more."""
_ROUNDS = 6
"""Steps of a fit of the wave."""
_GAINED = 0.5
"""Nats of a turn below which it was the last."""


def find_uneven_wave(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
    """The healthy valve with the likeliest load that swings unevenly.

    It is looked for with some lags and dead times, not with the process of the sticky valve: beside
    that the load is what the stem does apart from OP. None where none is found, or has no hope to
    become as likely as ``least``.
    """
    healthy = replace(sticky, valve=None, stem=case.rows.u, taps=DRIFT_AND_NOISE, nuisances=())
    starts = []
    for lags, at_valve in ((_AT_VALVE, True), (_AT_PV, False)):
        for slow, dead_time in lags:
            if dead_time <= case.max_dead_time:
                poles = Poles(Shape.LAGS, slow)
                starts.append((replace(healthy, poles=poles, dead_time=dead_time), at_valve))
    return _likeliest(case, starts, least)


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
    starts: list[tuple[Hypothesis, bool]],
    least: float,
    known: tuple[tuple[Array, Array], ...] = (),
) -> Hypothesis | None:
    """The likeliest wave from processes beside which it enters at the valve, or at PV."""
    tried: list[tuple[float, Hypothesis, bool, Wave]] = []
    for start, at_valve in starts:
        outline = outline_load(case, start, at_valve, _OUTLINED)
        for times, heights in (*turns_of(outline), *known):
            wave = Wave(times, heights, np.zeros((2, 0)), start.poles, 0.0, 0.0)
            wave = fit_wave(case, start, start.taps, at_valve, wave, rounds=3, spreads=1)
            others, sticky = without_load(start), start.valve is not None
            price = case.price(wave.poles, others, start.taps, sticky) + wave.price
            tried.append((case.log_likelihood(wave.squares) - price, start, at_valve, wave))
    tried.sort(key=lambda one: -round(one[0], 6))
    best: tuple[Hypothesis, Wave, bool] | None = None
    followed: list[tuple[float, bool]] = []
    for worth, start, at_valve, wave in tried:
        if worth < least - _HOPE or len(followed) == _FOLLOWED:
            break
        if any(way == at_valve and abs(worth - one) < _ALIKE for one, way in followed):
            continue
        followed.append((worth, at_valve))
        found, last = _in_turn(case, start, start.taps, at_valve, wave, _TURNS)
        if best is None or found.likelihood > best[0].likelihood:
            best = found, last, at_valve
    if best is None or best[0].likelihood < least - _BENT:
        return None
    start, wave, at_valve = best
    ends = [start]
    for count in _BENDS:
        bent = replace(wave, bends=np.zeros((2, count)))
        ends.append(_in_turn(case, start, start.taps, at_valve, bent, _LONG)[0])
    return max(ends, key=lambda one: one.likelihood)


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
