"""How likely a sticky valve is whose friction is another one at every slip.

A law of friction fixes each slip by the one before. Where a real stem slips early, the law's stem
stays where it was and misses that slip and those after it: from there on the two part, however late
or off single strokes may be (`estimator.evidence.varying_slips`). Here the static and the dynamic
friction of each slip are drawn from normal distributions, the slips are found in PV, and the
likelihood is that of PV over all of them (`estimator.hypotheses.friction_paths`). Means and
deviations of the frictions are those that make the window likeliest; the process is fitted to the
likeliest stem in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.hypotheses.friction_paths import Frictions, ProcessOfPaths, follow_paths
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import delay
from estimator.hypotheses.nuisances import Characteristic, Nuisance
from estimator.processes.poles import Poles
from estimator.search.processes import refine_poles

__all__ = ["is_beyond_slips", "lead_of_slips"]

_NEITHER_EXACT = 2.0
"""Times what a sticky valve is asked for, by which a load of any shape must be likelier than a
valve whose slips vary: corners and slips of chance make both explain what they do not model. Of the
tuning family's sticky valves two are behind at all, by 19 and 45 nats (held records); of 16 healthy
ones under a wandering triangle that are behind 13 are so by 20 to 319."""

_DEVIATIONS = (0.06, 0.04, 0.4)
"""Deviations at first of static and dynamic friction, as shares of S, and of the share of a slip
that comes a sample late: wide enough to pass over a wrong mean."""
_JUMPS = (None, 0.5)
"""J at first as shares of S: that of the law and one in the middle, because J trades with the
gain."""
_LEAST_JUMP = 0.03
"""J as a share of S below which the gain is no more raised as J falls."""
_LEAST_STATIC, _LEAST_DYNAMIC, _MOST_LATE = 0.003, 0.001, 2.0
"""Bounds of the deviations, as those at first are given: below them PV tells nothing."""
_STEPS = (0.05, 0.15, 0.7, 0.7, 0.7, 0.4, 0.1)
"""First steps of `_Numbers`, in their order: a few of them span what starts may differ by."""
_IN_TURN = (5, 1, 6, 0, 2, 3, 4)
"""Order in which the numbers are moved: the noise first, or a wrong one hides the others."""
_WIDER, _NARROWER = 1.5, 0.5
"""Factors of a step that paid, and of one that did not."""
_LOOKS, _SWEEPS, _PAYS = 3, 10, 0.3
"""Times that a start's stem is found before its numbers are moved, sweeps over the numbers from a
start, and nats that a sweep must gain to be followed by another."""
_TIE = 1e-6
"""Nats below which two are as likely: rounding decides nothing."""
_FREE = 3
"""Parameters beside those of a valve: three deviations."""
_FEWEST_LEVELS = 200
"""Levels of OP from which its resolution is as good as none."""
_FINE = 1e-4
"""Resolution of such an OP, as a share of its span."""


@dataclass(frozen=True, slots=True)
class _Start:
    """A valve's stem, process and numbers, as far as they are known."""

    stem: Array
    poles: Poles
    dead_time: int
    nuisances: tuple[Nuisance, ...]
    taps: Array
    numbers: Array
    """Logarithm of S; J over S; logarithms of the deviations of static and dynamic friction over
    S, of the late share, of the variance of the noise, and of gain times J over S."""
    slides: bool
    is_fitted: bool = False
    likelihood: float = -math.inf


@dataclass(frozen=True, slots=True)
class _Stage:
    """A process, a noise model and gains beside which the numbers of a valve are moved."""

    case: Case
    start: _Start
    target: Array
    gains: Array
    price: float
    quantum: float

    def follow(self, numbers: Array) -> tuple[float, Array]:
        """Log-likelihood in nats, prices included, and the likeliest stem."""
        rows, poles = self.case.rows, self.start.poles
        scale = math.exp(numbers[6]) / max(numbers[1], _LEAST_JUMP)
        gains = float(scale * self.gains[0]), float(scale * self.gains[1])
        variance = max(math.exp(numbers[5]), rows.floor)
        process: ProcessOfPaths = poles.coefficients, gains, self.start.dead_time, variance
        worth, stem = follow_paths(
            rows.u,
            self.target,
            rows.weight,
            self.start.taps,
            float(self.start.stem[0]),
            _frictions(numbers),
            process,
            self.quantum,
            self.start.slides,
        )
        return worth + 0.5 * rows.count - self.price, stem


def lead_of_slips(case: Case, sticky: Hypothesis, loaded: Hypothesis) -> float:
    """Nats by which a sticky valve whose friction varies is likelier than a load, prices included.

    Where that is enough for a sticky valve, more is not sought.

    Args:
        case: the window.
        sticky: the likeliest valve of one friction.
        loaded: a healthy valve with a load of any shape; its process is tried as well.
    """
    enough = loaded.likelihood + case.settings.judging.threshold
    return _likelihood(case, sticky, loaded, enough) - loaded.likelihood


def is_beyond_slips(case: Case, lead: float) -> bool:
    """Whether a load of any shape is likelier than slips that vary by enough to believe in it."""
    return lead <= -_NEITHER_EXACT * case.settings.judging.threshold


def _likelihood(case: Case, sticky: Hypothesis, loaded: Hypothesis, enough: float) -> float:
    """Log-likelihood in nats, prices included; a likelier one than ``enough`` is not sought."""
    quantum, found = _resolution(case.rows.u), []
    for alike in _starts(sticky, loaded):
        first = (_looked_at(case, sticky, one, quantum) for one in alike)
        found.append(max(first, key=lambda one: one.likelihood))
    found.sort(key=lambda one: -one.likelihood)
    best = -math.inf
    for start in found:
        best = max(best, _fitted(case, sticky, start, quantum, _SWEEPS).likelihood)
        if best >= enough:
            break
    return best


def _starts(sticky: Hypothesis, loaded: Hypothesis) -> Iterator[tuple[_Start, _Start]]:
    """Starts that differ in what a search does not leave again, with and without sliding."""
    valve = sticky.valve
    assert valve is not None
    own = max(valve.jump / valve.band, _LEAST_JUMP)
    # what a law leaves of slips may have been taken for a load
    alone = tuple(one for one in sticky.nuisances if isinstance(one, Characteristic))
    beside = {sticky.nuisances: None, alone: None}
    for process, nuisances, jump in product((sticky, loaded), beside, _JUMPS):
        # OP and PV tell the size of a slip in PV: the gain falls as J rises
        numbers = (math.log(valve.band), jump or own, *np.log(_DEVIATIONS), 0.0, math.log(own))
        start = _Start(
            sticky.stem,
            process.poles,
            process.dead_time,
            nuisances,
            process.taps,
            np.array(numbers),
            slides=False,
        )
        yield start, replace(start, slides=True)


def _looked_at(case: Case, sticky: Hypothesis, start: _Start, quantum: float) -> _Start:
    """A start whose stem was found anew some times, and whose numbers were moved once."""
    for _ in range(_LOOKS):
        stage = _stage(case, sticky, start, quantum)
        start = _refitted(stage, *stage.follow(stage.start.numbers))
    return _fitted(case, sticky, start, quantum, 1)


def _fitted(case: Case, sticky: Hypothesis, start: _Start, quantum: float, sweeps: int) -> _Start:
    """Numbers and process in turn, from a start; the likeliest of all that was tried."""
    steps, way = np.array(_STEPS), np.ones(len(_STEPS))
    best = start
    for sweep in range(sweeps):
        stage = _stage(case, sticky, start, quantum)
        numbers = stage.start.numbers
        likelihood, stem = stage.follow(numbers)
        for i in _IN_TURN:
            for sign in (way[i], -way[i]):
                tried = numbers.copy()
                tried[i] += sign * steps[i]
                if not 0.0 <= tried[1] <= 1.0:
                    continue
                worth, other = stage.follow(tried)
                if worth > likelihood + _TIE:
                    numbers, likelihood, stem = tried, worth, other
                    steps[i], way[i] = steps[i] * _WIDER, sign
                    break
            else:
                steps[i] *= _NARROWER
        moved = replace(stage, start=replace(stage.start, numbers=numbers))
        before, start = best, replace(_refitted(moved, likelihood, stem), is_fitted=True)
        best = max(best, start, key=lambda one: one.likelihood)
        if sweep > 1 and best.likelihood < before.likelihood + _PAYS:
            break
    return best


def _stage(case: Case, sticky: Hypothesis, start: _Start, quantum: float) -> _Stage:
    """Noise model and gains fitted to a start's stem; the variance too where none was known."""
    stem, poles, late = start.stem, start.poles, start.dead_time
    fit = case.fit(sticky.valve, poles, late, start.nuisances, start.taps, stem=stem)
    response = poles.response(stem)
    # without the columns
    shown = fit.residual + fit.gains[0] * delay(response, late)
    shown += fit.gains[1] * delay(response, late + 1)
    taps = np.ascontiguousarray(fit.taps)
    target = filter_rows(shown[None], taps, case.rows.weight)[0]
    price = case.price(poles, fit.nuisances, taps, valve=True)
    price += 0.5 * _FREE * math.log(case.rows.count)
    numbers = start.numbers.copy()
    if not start.is_fitted:
        numbers[5] = math.log(fit.squares / case.rows.count + case.rows.floor)
    start = replace(start, numbers=numbers, taps=taps)
    return _Stage(case, start, target, fit.gains, price, quantum)


def _refitted(stage: _Stage, likelihood: float, stem: Array) -> _Start:
    """A start with this stem, and the process fitted to it; its gains are those of a fit then."""
    start, numbers = stage.start, stage.start.numbers.copy()
    numbers[6] = math.log(max(numbers[1], _LEAST_JUMP))
    poles, late = refine_poles(
        stage.case, stem, start.poles, start.dead_time, start.nuisances, start.taps
    )
    return replace(
        start, stem=stem, poles=poles, dead_time=late, numbers=numbers, likelihood=likelihood
    )


def _frictions(numbers: Array) -> Frictions:
    band = math.exp(numbers[0])
    jump = band * numbers[1]
    static, dynamic, late = (math.exp(one) for one in numbers[2:5])
    return (
        0.5 * (band + jump),
        0.5 * (band - jump),
        band * max(static, _LEAST_STATIC),
        band * max(dynamic, _LEAST_DYNAMIC),
        min(late, _MOST_LATE),
    )


def _resolution(op: Array) -> float:
    """Step in which OP was recorded, as a share of its span."""
    levels = np.diff(np.unique(np.round(op, 9)))
    return float(levels.min()) if 0 < levels.size < _FEWEST_LEVELS else _FINE
