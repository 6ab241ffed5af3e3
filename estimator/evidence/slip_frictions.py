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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.hypotheses.friction_paths import Frictions, ProcessOfPaths, follow_paths
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.linear_fit import delay
from estimator.hypotheses.nuisances import Characteristic, Nuisance
from estimator.hypotheses.strokes import strokes_of
from estimator.processes.poles import Poles
from estimator.rows import step_of_levels
from estimator.search.processes import refine_poles

__all__ = [
    "LEAST_JUMP",
    "VaryingFriction",
    "find_varying_friction",
    "is_beyond_slips",
    "lead_of_slips",
]

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
LEAST_JUMP = 0.03
"""J as a share of S below which the gain is no more raised as J falls: none looks alike."""
_LEAST_STATIC, _LEAST_DYNAMIC, _MOST_LATE = 0.003, 0.001, 2.0
"""Bounds of the deviations, as those at first are given: below them PV tells nothing."""
_SURE = (0.003, 0.001, 0.003)
"""Deviations, as those at first are given, of a valve that slips where its law says."""
_BAND, _JUMP, _STATIC, _DYNAMIC, _LATE, _NOISE, _SLIP = range(7)
"""Places of a valve's numbers: logarithm of S; J over S; logarithms of the deviations of static and
dynamic friction over S, of the late share, of the variance of the noise, and of gain times J over
S."""
_STEPS = (0.05, 0.15, 0.7, 0.7, 0.7, 0.4, 0.1)
"""First steps of those: a few of them span what starts may differ by."""
_IN_TURN = (_NOISE, _JUMP, _SLIP, _BAND, _STATIC, _DYNAMIC, _LATE)
"""Order in which the numbers are moved: the noise first, or a wrong one hides the others."""
_WIDER, _NARROWER = 1.5, 0.5
"""Factors of a step that paid, and of one that did not."""
_LATER = (-4, -2, -1, 1, 2, 4)
"""Samples by which slips are tried later: a few of them span what a law mistakes for dead time."""
_LOOKS, _SWEEPS, _PAYS = 3, 10, 0.3
"""Times that a start's stem is found before its numbers are moved, sweeps over the numbers from a
start, and nats that a sweep must gain to be followed by another."""
_TIE = 1e-6
"""Nats below which two are as likely: rounding decides nothing."""
_MOST_VARYING = 0.5
"""Deviation of S from slip to slip, as a share of S, beyond which a load stands for the friction:
of simulated valves whose friction deviates by 2 to 20 % one of 47 is beyond, healthy valves under
ramps of the load are, with 0.8 and more."""
_FREE = 3
"""Parameters beside those of a valve: three deviations."""
_FINE = 1e-4
"""Resolution of an OP without levels, as a share of its span."""


@dataclass(frozen=True, slots=True)
class VaryingFriction:
    """A sticky valve whose friction is another one at every slip.

    Attributes:
        hypothesis: S and J are means over the slips; the stem is the likeliest one, the process is
            fitted to it, and the likelihood is that over all stems.
        static, dynamic: deviations of both frictions from slip to slip, as shares of OP's span.
    """

    hypothesis: Hypothesis
    static: float
    dynamic: float

    @property
    def deviation(self) -> float:
        """Deviation of S from slip to slip, as a share of OP's span."""
        return math.hypot(self.static, self.dynamic)


@dataclass(frozen=True, slots=True)
class _Window:
    """What all starts share: the rows, a law's valve, and the step in which OP was recorded."""

    case: Case
    valve: Valve
    quantum: float


@dataclass(frozen=True, slots=True)
class _Start:
    """A valve's stem, process and numbers, as far as they are known."""

    stem: Array
    poles: Poles
    dead_time: int
    nuisances: tuple[Nuisance, ...]
    taps: Array
    numbers: Array
    slides: bool
    is_fitted: bool = False
    likelihood: float = -math.inf


@dataclass(frozen=True, slots=True)
class _Stage:
    """A process, a noise model and gains beside which the numbers of a valve are moved."""

    window: _Window
    start: _Start
    target: Array
    gains: Array
    price: float

    def follow(self, numbers: Array) -> tuple[float, Array]:
        """Log-likelihood in nats, prices included, and the likeliest stem."""
        rows, poles = self.window.case.rows, self.start.poles
        scale = math.exp(numbers[_SLIP]) / max(numbers[_JUMP], LEAST_JUMP)
        gains = float(scale * self.gains[0]), float(scale * self.gains[1])
        variance = max(math.exp(numbers[_NOISE]), rows.floor)
        process: ProcessOfPaths = poles.coefficients, gains, self.start.dead_time, variance
        worth, stem = follow_paths(
            rows.u,
            self.target,
            rows.weight,
            self.start.taps,
            float(self.start.stem[0]),
            _frictions(numbers),
            process,
            self.window.quantum,
            self.start.slides,
        )
        return worth + 0.5 * rows.count - self.price, stem

    def refit(self, numbers: Array, likelihood: float, stem: Array) -> _Start:
        """A start of these, and the process fitted to the stem; its gains are those of a fit."""
        start, numbers = self.start, numbers.copy()
        numbers[_SLIP] = math.log(max(numbers[_JUMP], LEAST_JUMP))
        poles, late = refine_poles(
            self.window.case, stem, start.poles, start.dead_time, start.nuisances, start.taps
        )
        return replace(
            start, stem=stem, poles=poles, dead_time=late, numbers=numbers, likelihood=likelihood
        )


def lead_of_slips(case: Case, sticky: Hypothesis, loaded: Hypothesis) -> float:
    """Nats by which a sticky valve whose friction varies is likelier than a load, prices included.

    Where that is enough for a sticky valve, more is not sought.

    Args:
        case: the window.
        sticky: the likeliest valve of one friction.
        loaded: a healthy valve with a load of any shape; its process is tried as well.
    """
    enough = loaded.likelihood + case.settings.judging.threshold
    window = _window(case, sticky)
    starts = [one for of in (sticky, loaded) for one in _starts(sticky, of)]
    return _likeliest(window, starts, enough).likelihood - loaded.likelihood


def is_beyond_slips(case: Case, lead: float) -> bool:
    """Whether a load of any shape is likelier than slips that vary by enough to believe in it."""
    return lead <= -_NEITHER_EXACT * case.settings.judging.threshold


def find_varying_friction(case: Case, sticky: Hypothesis) -> VaryingFriction | None:
    """The valve where its friction varies; None where a law says as much of it.

    Asked of a valve that is likelier than a healthy one: its numbers, strokes and parts of the
    window change, the evidence stays. It is not sought where deviations do not pay beside the law's
    own stem.

    Args:
        case: the window.
        sticky: the likeliest valve of one friction.
    """
    window = _window(case, sticky)
    starts = list(_starts(sticky, sticky))
    if not _varies(window, starts[0]):
        return None
    # the first is as good as the best
    found = _likeliest(window, starts, -math.inf)
    if found.likelihood < sticky.likelihood + case.settings.judging.threshold:
        return None
    band, jump = math.exp(found.numbers[_BAND]), float(found.numbers[_JUMP])
    valve = Valve(band, jump * band, float(found.stem[0]), window.valve.law)
    fit = case.fit(
        valve, found.poles, found.dead_time, found.nuisances, found.taps, stem=found.stem
    )
    _, _, static, dynamic, _ = _frictions(found.numbers)
    varying = VaryingFriction(replace(fit, likelihood=found.likelihood), static, dynamic)
    return varying if varying.deviation <= _MOST_VARYING * band else None


def _window(case: Case, sticky: Hypothesis) -> _Window:
    assert sticky.valve is not None
    return _Window(case, sticky.valve, step_of_levels(case.rows.u) or _FINE)


def _varies(window: _Window, alike: tuple[_Start, _Start]) -> bool:
    """Whether a law's slips are likelier where they may be off than where they may not."""
    stages = [_stage(window, one) for one in alike]
    worth = []
    for deviations in (_SURE, _DEVIATIONS):
        numbers = stages[0].start.numbers.copy()
        numbers[_STATIC : _LATE + 1] = np.log(deviations)
        worth.append(max(stage.follow(numbers)[0] for stage in stages))
    return worth[1] > worth[0] + _TIE


def _likeliest(window: _Window, starts: Sequence[tuple[_Start, _Start]], enough: float) -> _Start:
    """The likeliest from starts that come in pairs; one that is likelier than enough will do."""
    found = [
        max((_looked_at(window, one) for one in alike), key=lambda one: one.likelihood)
        for alike in starts
    ]
    fitted: list[_Start] = []
    for start in sorted(found, key=lambda one: -one.likelihood):
        fitted.append(_fitted(window, _beside_any_delay(window, start), _SWEEPS))
        if fitted[-1].likelihood >= enough:
            break
    return max(fitted, key=lambda one: one.likelihood)


def _beside_any_delay(window: _Window, start: _Start) -> _Start:
    """A start whose slips are some samples later or earlier, and the dead time as much shorter.

    S hangs on it and no slip does: how alike the frictions are tells which is the valve's.
    """
    case, best = window.case, start
    while True:
        tried = []
        for later in _LATER:
            late = best.dead_time - later
            if not case.rows.soonest <= late <= case.max_dead_time:
                continue
            at = np.clip(np.arange(best.stem.size) - later, 0, best.stem.size - 1)
            stem = best.stem[at]
            numbers = _read_off(case.rows.u, stem, best.numbers)
            stage = _stage(window, replace(best, stem=stem, dead_time=late, numbers=numbers))
            tried.append(stage.refit(stage.start.numbers, *stage.follow(stage.start.numbers)))
        found = max(tried, key=lambda one: one.likelihood, default=best)
        if found.likelihood < best.likelihood + _PAYS:
            return best
        best = found


def _starts(sticky: Hypothesis, process: Hypothesis) -> Iterator[tuple[_Start, _Start]]:
    """Starts that differ in what a search does not leave again, with and without sliding."""
    valve = sticky.valve
    assert valve is not None
    own = max(valve.jump / valve.band, LEAST_JUMP)
    # what a law leaves of slips may have been taken for a load
    alone = tuple(one for one in sticky.nuisances if isinstance(one, Characteristic))
    beside = {sticky.nuisances: None, alone: None}
    for nuisances, jump in product(beside, _JUMPS):
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


def _looked_at(window: _Window, start: _Start) -> _Start:
    """A start whose stem was found anew some times, and whose numbers were moved once."""
    for _ in range(_LOOKS):
        stage = _stage(window, start)
        start = stage.refit(stage.start.numbers, *stage.follow(stage.start.numbers))
    return _fitted(window, start, 1)


def _fitted(window: _Window, start: _Start, sweeps: int) -> _Start:
    """Numbers and process in turn, from a start; the likeliest of all that was tried."""
    steps, way = np.array(_STEPS), np.ones(len(_STEPS))
    best = start
    for sweep in range(sweeps):
        stage = _stage(window, start)
        numbers = stage.start.numbers
        likelihood, stem = stage.follow(numbers)
        for i in _IN_TURN:
            for sign in (way[i], -way[i]):
                tried = numbers.copy()
                tried[i] += sign * steps[i]
                if not 0.0 <= tried[_JUMP] <= 1.0:
                    continue
                worth, other = stage.follow(tried)
                if worth > likelihood + _TIE:
                    numbers, likelihood, stem = tried, worth, other
                    steps[i], way[i] = steps[i] * _WIDER, sign
                    break
            else:
                steps[i] *= _NARROWER
        before = best.likelihood
        start = replace(stage.refit(numbers, likelihood, stem), is_fitted=True)
        best = max(best, start, key=lambda one: one.likelihood)
        if sweep > 1 and best.likelihood < before + _PAYS:
            break
    return best


def _read_off(op: Array, stem: Array, numbers: Array) -> Array:
    """Numbers of a valve whose frictions are those of a stem's slips, both ways alike.

    The process stays: what the slips are in PV is what it is with that stem.
    """
    begins, _ = strokes_of(stem)
    way = np.sign(stem[begins] - stem[begins - 1])
    static, dynamic = way * (op[begins] - stem[begins - 1]), way * (op[begins] - stem[begins])
    if not ((way > 0.0).any() and (way < 0.0).any()):
        return numbers
    # where the stem is off by as much all the time, both ways differ and their mean does not
    means, spreads = [], []
    for friction in (static, dynamic):
        of_ways = [friction[way == one] for one in (-1.0, 1.0)]
        means.append(0.5 * sum(float(one.mean()) for one in of_ways))
        spreads.append(math.sqrt(sum(float(one.var()) * one.size for one in of_ways) / way.size))
    band = means[0] + means[1]
    if not 0.0 <= means[1] <= means[0]:
        return numbers
    found = numbers.copy()
    found[_BAND], found[_JUMP] = math.log(band), (means[0] - means[1]) / band
    least = max(numbers[_JUMP], LEAST_JUMP)
    found[_SLIP] += math.log(max(found[_JUMP], LEAST_JUMP) / least)
    found[_STATIC] = math.log(max(spreads[0] / band, _LEAST_STATIC))
    found[_DYNAMIC] = math.log(max(spreads[1] / band, _LEAST_DYNAMIC))
    return found


def _stage(window: _Window, start: _Start) -> _Stage:
    """Noise model and gains fitted to a start's stem; the variance too where none was known."""
    case, stem, poles, late = window.case, start.stem, start.poles, start.dead_time
    fit = case.fit(window.valve, poles, late, start.nuisances, start.taps, stem=stem)
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
        numbers[_NOISE] = math.log(fit.squares / case.rows.count + case.rows.floor)
    return _Stage(window, replace(start, numbers=numbers, taps=taps), target, fit.gains, price)


def _frictions(numbers: Array) -> Frictions:
    band = math.exp(numbers[_BAND])
    jump = band * numbers[_JUMP]
    static, dynamic, late = (math.exp(numbers[one]) for one in (_STATIC, _DYNAMIC, _LATE))
    return (
        0.5 * (band + jump),
        0.5 * (band - jump),
        band * max(static, _LEAST_STATIC),
        band * max(dynamic, _LEAST_DYNAMIC),
        min(late, _MOST_LATE),
    )
