"""The figures of a loop that practitioners expect; the unit ends the name.

Sources: Harris (1989) and Desborough and Harris (1992) for the index of minimum variance;
Thornhill, Huang and Zhang (2003) for the oscillation; travel and reversals as ISA-TR75.25.02.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array, Mask
from estimator.diagnosis.facts import Limits, Sensor
from estimator.diagnosis.oscillation import Oscillation
from estimator.monitoring.indices import harris_index, valve_wear
from estimator.outcomes import EstimatorError

__all__ = [
    "few_steps",
    "figures_of",
    "predictable_share",
    "settling",
    "share_around",
    "without_wave",
]

_HOUR = 3600.0
_NEAR = 0.1
"""Half-width of the band around an oscillation, as a share of its frequency."""
_PAST = 10
"""Past values of a regression, as far apart as a tenth of its horizon."""
_SETTLED = 0.05
"""A loop has settled once the error stays below this share of the step (ISA-51.1's 5 %)."""


def figures_of(
    op: Array,
    pv: Array | None,
    error: Array | None,
    sp: Array | None,
    auto: Mask | None,
    period: float,
    dead_time: int | None,
    swing: Oscillation,
    limits: Limits,
    sensor: Sensor | None,
) -> dict[str, float]:
    """Figures by name; NaN where the record does not hold one.

    Args:
        op, pv, error, sp, auto: samples without holes, ``(n,)``; None where not recorded.
        period: seconds between samples.
        dead_time: samples from OP to PV, None where unknown (the Harris index then needs it).
        swing, limits, sensor: what was found.
    """
    noise_of_op = _noise_band(op)
    wear = valve_wear(op, period=period, deadband=noise_of_op)
    span = float(np.ptp(op))
    found = {
        "op_std": float(np.std(op)),
        "op_travel_per_day": wear.travel_per_day,
        "op_reversals_per_day": wear.reversals_per_day,
        "op_mean": float(np.mean(op)),
        "op_span": span,
        "time_at_limits_share": limits.share,
        "oscillation_period_s": swing.period_s,
        "oscillation_regularity": swing.regularity,
        "oscillation_amplitude": swing.amplitude,
        "oscillation_cycles": swing.cycles,
        "oscillation_share": swing.share,
        "time_in_automatic_share": math.nan if auto is None else float(np.mean(auto)),
    }
    if pv is None or error is None:
        return found
    found |= {
        "pv_std": float(np.std(pv)),
        "error_mean": float(np.mean(error)),
        "error_std": float(np.std(error)),
        "iae_per_hour": float(np.mean(np.abs(error))) * _HOUR,
        "noise_band_pv": 2.0 * sensor.noise if sensor is not None else math.nan,
        "harris_index": _harris(error, dead_time),
    }
    found |= settling(sp, error, period)
    return found


def _noise_band(op: Array) -> float:
    """Two deviations of OP's noise: smaller turns do not count as reversals."""
    moves = np.abs(np.diff(op))
    moving = moves[moves > 0.0]
    return 2.0 * float(np.median(moving)) if moving.size else 0.0


def _harris(error: Array, dead_time: int | None) -> float:
    if dead_time is None:
        return math.nan
    try:
        return harris_index(error, dead_time=max(1, dead_time))
    except EstimatorError:
        # too short a record for the regression
        return math.nan


def predictable_share(error: Array, ahead: int) -> float:
    """Share of the error's variance that its own past tells ``ahead`` samples before.

    One minus the Harris index at that horizon: a controller that had answered within it would not
    have left it (Thornhill, Oettinger and Fedenczuk 1999, "Refinery-wide control loop performance
    assessment", Journal of Process Control 9, 109-124). The past is taken a tenth of the horizon
    apart, so that it reaches back as far as the horizon is long.
    """
    apart = max(1, ahead // _PAST)
    groups = error[: error.size // apart * apart].reshape(-1, apart)
    # a group with a bad sample is bad
    thinned = groups.mean(axis=1)
    try:
        index = harris_index(thinned, dead_time=max(1, round(ahead / apart)), order=_PAST)
    except EstimatorError:
        return math.nan
    return 1.0 - index


def few_steps(samples: int) -> int:
    """Set-point moves above which the set-point is the output of another loop."""
    return samples // 20


def settling(sp: Array | None, error: Array, period: float) -> dict[str, float]:
    """Settling time, overshoot and decay ratio after set-point steps: medians over the steps."""
    nothing = {
        "setpoint_steps": 0.0,
        "settling_time_s": math.nan,
        "overshoot_share": math.nan,
        "decay_ratio": math.nan,
    }
    if sp is None:
        return nothing
    moves = np.diff(sp)
    at = np.flatnonzero(np.abs(moves) > 0.0)
    if at.size == 0 or at.size > few_steps(sp.size):
        return nothing
    noise = _noise_of(error)
    times, overshoots, decays = [], [], []
    for start, stop in zip(at + 1, [*(at[1:] + 1), sp.size], strict=True):
        step = float(moves[start - 1])
        rest = error[start:stop] / step
        if rest.size < 10 or abs(step) < 3.0 * noise:
            continue
        outside = np.flatnonzero(np.abs(rest) > max(_SETTLED, 3.0 * noise / abs(step)))
        if outside.size and outside[-1] < rest.size - 1:
            times.append(float(outside[-1] + 1) * period)
        first = -float(rest.min())
        overshoots.append(max(0.0, first))
        if first > 0.02:
            later = rest[int(rest.argmin()) :]
            again = later[int(later.argmax()) :]
            decays.append(max(0.0, -float(again.min())) / first)
    if not overshoots:
        return nothing
    return {
        "setpoint_steps": float(len(overshoots)),
        "settling_time_s": float(np.median(times)) if times else math.nan,
        "overshoot_share": float(np.median(overshoots)),
        "decay_ratio": float(np.median(decays)) if decays else 0.0,
    }


def _noise_of(error: Array) -> float:
    return float(np.median(np.abs(np.diff(error)))) / 0.6745 / math.sqrt(2.0)


def share_around(signal: Array, period: float) -> float:
    """Share of a signal's variance around a period given in samples, 0 to 1."""
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(signal.size))) ** 2
    cycles = np.arange(power.size) * period / signal.size
    near = (np.abs(cycles - 1.0) < _NEAR) | (np.abs(cycles - 1.0) * signal.size < 2.0 * period)
    whole = float(power.sum())
    return float(power[near].sum()) / whole if whole > 0.0 else 0.0


def without_wave(signal: Array, period: float) -> Array:
    """The signal ``(n,)`` without what is around a period given in samples, nor its harmonics."""
    lines = np.fft.rfft(signal)
    cycles = np.arange(lines.size) * period / signal.size
    order = np.clip(np.round(cycles), 1.0, 3.0)
    reach = np.maximum(_NEAR * order, 2.0 * period / signal.size)
    lines[np.abs(cycles - order) < reach] = 0.0
    return np.asarray(np.fft.irfft(lines, signal.size))
