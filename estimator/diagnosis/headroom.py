"""How much more integral gain a record leaves room for: a posterior, over processes and loads.

A loop whose load is smooth and a slow loop whose load jumps give nearly one control error. They
differ in what the controller does to the noise of the transmitter and to fast loads: a fast loop
shapes them after its dead time, a slow one leaves them as they are. That shows only where the noise
model can be nothing but loads and a transmitter. Therefore a lag (or an integrator) with a dead
time is fitted beside a load of one corner, entering before or behind the process, and white noise
on PV. Every structure and dead time counts by its likelihood.

Beside a slow load before the process there may be a fast one, white, whose share is free: plants
have both. Without it a slow process with a fast valve, which answers sooner than it does, stands
for what the fast load does, and a well-tuned loop seems to have room.

The process may have a second lag, the load behind it two equal ones. A load before the process has
one: OP itself is as smooth as a load of two, and whatever the process is, a load that mirrors OP
would explain the record.

The fit is a prediction error method with the true noise structure, so feedback does not bias it
(Ljung 1999, section 13.4). The innovations filter is the spectral factor of load plus noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Index
from estimator.controller.controller import Controller
from estimator.diagnosis.delay_loops import sensitivities
from estimator.diagnosis.headroom_search import (
    Bounds,
    Kind,
    fit_numbers,
    least_numbers,
    process_poles,
)
from estimator.diagnosis.linear_loop import TURNS, LinearLoop
from estimator.diagnosis.loop_record import LoopRecord, longest_stretch, without_steady_wave
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings, Headroom
from estimator.diagnosis.tuning_rules import HOLD, simc_lag
from estimator.window import bridge
from loop_model import ProcessModel

__all__ = ["headroom_of", "probability_of_headroom"]

_GAIN_POINTS = np.array([-1.28, -0.52, 0.0, 0.52, 1.28])
"""Five equally likely points of a normal distribution: the gain is spread by its deviation."""
_LOOKS = 6
"""Looks for jumps of the load, each without those that the one before found."""


@dataclass(frozen=True, slots=True)
class _Structure:
    """``order`` poles of the load, ``behind`` the process or before it, and its kind.

    A process that is not integrating has a second lag of ``second`` times the first.
    """

    order: int
    behind: bool
    integrating: bool
    second: float = 0.0

    @property
    def kind(self) -> Kind:
        """The same for the compiled search."""
        return self.order, self.behind, self.integrating, self.second


def _structures(settings: Headroom) -> tuple[_Structure, ...]:
    # behind an integrator a load wanders like one before it
    return (
        *(_Structure(1, False, False, second) for second in (0.0, *settings.seconds)),
        _Structure(1, False, True),
        _Structure(1, True, False),
        _Structure(2, True, False),
    )


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Minus log-likelihood and gain with its deviation of every dead time, ``(d,)``, from 1 on."""

    costs: Array
    gains: Array
    deviations: Array


def headroom_of(
    record: LoopRecord,
    controller: Controller | None,
    swing: Oscillation,
    settings: DiagnosisSettings,
) -> float:
    """The probability by a record; NaN where it is too short, or has no controller.

    A steady wave is taken out of OP and PV alike: the fitted load cannot make one.

    The longest stretch counts in which the controller is in automatic and ``record.good``: samples
    at a limit are none. Short holes are bridged.
    """
    if controller is None or record.pv is None:
        return math.nan
    stretch = longest_stretch(record, settings.scope.hole)
    if stretch.stop - stretch.start < settings.headroom.least:
        return math.nan
    signals = (np.where(record.good, one, math.nan)[stretch] for one in (record.op, record.pv))
    op, pv = (without_steady_wave(bridge(one), swing, record.period, settings) for one in signals)
    return probability_of_headroom(op, pv, controller, record.period, settings.headroom)


def probability_of_headroom(
    op: Array, pv: Array, controller: Controller, period: float, settings: Headroom
) -> float:
    """Probability that SIMC's settings have ``settings.slower`` times the integral gain and more.

    Args:
        op, pv: samples without holes, in automatic and within limits, ``(n,)``.
        controller: the running one.
        period: seconds between samples.
        settings: see `estimator.diagnosis.settings`.

    Returns:
        The probability; NaN where no process fits that leaves the running loop stable.
    """
    size = float(np.std(np.diff(pv)))
    if size == 0.0 or not np.ptp(op) or not controller.integral_rate:
        return math.nan
    u, y = op - op.mean(), (pv - pv.mean()) / size
    jumps = _load_jumps(u, y, settings)
    lag = max(2.0, controller.integral_time_s / period)
    start = np.log([lag, settings.white, settings.corner, settings.noise])
    weights, ratios = [], []
    for structure in _structures(settings):
        # an integrator has no lag, and what is white behind the process is noise
        has = np.array([not structure.integrating, not structure.behind, True, True])
        moves = np.vstack([np.zeros(int(has.sum())), np.diag(np.array(settings.reach)[has])])
        simplex = start[has] + moves
        found = least_numbers(
            simplex, structure.kind, y, u, _bounds(settings), jumps, settings.tries
        )
        fitted = _fit(found, structure, y, u, jumps, settings)
        if fitted is None:
            continue
        gains = size * (fitted.gains[:, None] + _GAIN_POINTS * fitted.deviations[:, None])
        # a scale that is not known: every octave of dead times is as likely before
        weights.append(-fitted.costs - np.log(1.0 + np.arange(fitted.costs.size)))
        process = process_poles(found, structure.kind)
        ratios.append(_headrooms(gains, process, controller, period, settings))
    return _share_of_slow(weights, ratios, settings)


def _bounds(settings: Headroom) -> Bounds:
    return settings.dead_times, settings.first, settings.farthest


def _share_of_slow(weights: list[Array], ratios: list[Array], settings: Headroom) -> float:
    """Share of the probability (logarithms ``(d,)``) whose headroom ``(d, g)`` is large, or NaN.

    A process that hardly moves PV leaves room without end: there loads alone explain PV, which is
    no news of how fast the loop is. Half of that counts.
    """
    if not ratios:
        return math.nan
    ratio = np.concatenate(ratios)
    weight = np.concatenate(weights)[:, None] + np.zeros(ratio.shape)
    is_slow = np.where(ratio > settings.most, 0.5, ratio >= settings.slower)
    counts = np.isfinite(ratio)
    if not counts.any():
        return math.nan
    chances = np.exp(weight[counts] - weight[counts].max())
    return float(np.average(is_slow[counts], weights=chances))


def _headrooms(
    gains: Array,
    process: tuple[float, float, float],
    controller: Controller,
    period: float,
    settings: Headroom,
) -> Array:
    """SIMC's integral gain over the running one; NaN where the running loop would swing.

    Args:
        gains: of the process in PV per OP, at dead times of 1, 2, ... samples, ``(d, g)``.
        process: its pole, its first step's share of the gain, and its second pole.
        controller, period, settings: as above.
    """
    pole, step, second = process
    late = np.array([controller.samples_late(1 + i) for i in range(gains.shape[0])])
    running = LinearLoop.of(ProcessModel((-pole,), (step,), 1, 0.0, period), controller)
    amplified = sensitivities(gains, late, process, running.r, running.t, TURNS)
    # SIMC's half rule: half of a second lag counts as lag, half as dead time
    half = 0.5 * _time(second) * period
    time = math.inf if pole == 1.0 else _time(pole) * period + half
    settled = [simc_lag(1.0, time, (one - HOLD) * period + half) for one in late]
    rates = np.array([gain / integral_time for gain, integral_time in settled])
    slopes = gains * (step / period if pole == 1.0 else 1.0 / time)
    runs = (slopes * controller.gain > 0.0) & (amplified <= settings.swings)
    ratios = np.full(gains.shape, math.nan)
    ratios[runs] = (rates[:, None] / slopes / controller.integral_rate)[runs]
    return ratios


def _time(pole: float) -> float:
    """Time constant of a pole, samples; 0 where there is none."""
    return -1.0 / math.log(pole) if pole > 0.0 else 0.0


def _load_jumps(u: Array, y: Array, settings: Headroom) -> Index:
    """Samples ``(k,)`` in which the load jumps: PV is far from what its and OP's past tell.

    A load of one corner does not jump. One sample in which it does outweighs hundreds that show
    the loop, and a fast process whose controller is slow would answer it as it comes. None where
    there are too many: such are the load.
    """
    past, late = settings.past, settings.dead_times + 1
    at = np.arange(settings.first, y.size)
    rows = np.stack(
        [*(y[at - i] for i in range(1, past + 1)), *(u[at - i] for i in range(1, late + 1)),
         np.ones(at.size)],
        axis=1,
    )  # fmt: skip
    used = np.ones(at.size, dtype=bool)
    for _ in range(_LOOKS):
        law = np.linalg.lstsq(rows[used], y[at][used], rcond=None)[0]
        left = np.abs(y[at] - rows @ law)
        now = left <= settings.jump * float(np.median(left[used])) / 0.6745
        if (now == used).all():
            break
        used = now
    if np.mean(~used) > settings.most_jumps:
        return at[:0]
    return at[~used]


def _fit(
    numbers: Array, structure: _Structure, y: Array, u: Array, out: Index, settings: Headroom
) -> _Fitted | None:
    """The gain at every dead time, level and straight line left free, samples ``out`` left out."""
    if np.abs(numbers).max() > settings.farthest:
        return None
    squares, gains, powers = fit_numbers(numbers, structure.kind, y, u, _bounds(settings), out)
    n = y.size - settings.first - out.size
    return _Fitted(0.5 * n * np.log(squares / n), gains, np.sqrt(squares / n / powers))
