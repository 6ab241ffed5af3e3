"""Facts that a record shows without any model: manual, limits, faults of the sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from estimator.arrays import Array, Mask
from estimator.controller.controller import Controller
from estimator.controller.reading import at_limit
from estimator.diagnosis.settings import Facts
from estimator.diagnosis.standing import held_runs, mask_of, moves_in_steps
from estimator.faults import find_spikes, runs_of

__all__ = [
    "USUAL_OP_SPAN",
    "Limits",
    "Sensor",
    "by_hand_of",
    "in_long_runs",
    "limits_of",
    "sensor_of",
    "span_of",
]

_USUAL = 0.95
"""Share of the error's moves from sample to sample that are usual ones."""
USUAL_OP_SPAN = 100.0
"""Units of OP: most controllers put out 0 to 100 %."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Where OP stands at a limit while the controller wants more.

    Attributes:
        share: of the samples.
        cost: share of the squared control error in those samples.
        high, low: whether it is the highest, the lowest value that is the limit.
        value: OP there; the more frequent one of two.
        where: which samples, ``(n,)``.
    """

    share: float
    cost: float
    high: bool
    low: bool
    value: float
    where: Mask


@dataclass(frozen=True, slots=True)
class Sensor:
    """What is wrong with PV.

    Attributes:
        frozen: share of the samples in long runs of one value; still: which samples, ``(n,)``.
        step: resolution over the standard deviation of the control error.
        spikes: share of the samples that are spikes; spike_cost: their share of the squared error.
        noise: standard deviation of the noise, units of PV.
        noise_share: its share of the variance of the control error.
        shaken: how far noise moves OP from sample to sample, as a share of its span.
    """

    frozen: float
    step: float
    spikes: float
    spike_cost: float
    noise: float
    noise_share: float
    shaken: float
    still: Mask


def by_hand_of(
    op: Array,
    auto: Mask | None,
    error: Array,
    controller: Controller | None,
    settings: Facts,
    period: float = 1.0,
    usable: Mask | None = None,
) -> Mask:
    """Samples in manual, ``(n,)``; from the signals where no mode was recorded.

    Without a mode a controller is in manual where OP stands still for long beside an error, for
    which the controller would have moved it (`estimator.diagnosis.standing`). A
    limit holds OP as well, at its highest or lowest value, as long as the errors since it was
    reached ask for more in sum; where they ask for less, a controller would have left it. A hand
    also sets one value right after another: a controller leaves a limit on its way through others.
    Only ``usable`` samples count: what bridges a hole is not OP.
    """
    if auto is not None:
        return ~auto
    if np.ptp(error) == 0.0:
        return np.zeros(op.size, dtype=bool)
    read = np.ones(op.size, dtype=bool) if usable is None else usable
    # without an error a controller keeps still
    runs = held_runs(op, error, controller, period, settings)
    still = mask_of(runs, op.size)
    still &= (error != 0.0) & read
    if np.ptp(op) == 0.0:
        return still
    limited = still & at_limit(op) & ~mask_of(_set_by_hand(runs, error), op.size)
    found = still & ~limited
    if controller is None or not controller.integral_rate:
        return found
    for start, stop in runs_of(limited):
        outwards = (op[start] - 0.5 * (op.max() + op.min())) * controller.integral_rate
        push = math.copysign(1.0, outwards) * error[start:stop]
        if np.mean(np.cumsum(push) < 0.0) > 1.0 - settings.pushed:
            found[start:stop] = True
    return found


def _set_by_hand(runs: list[tuple[int, int]], error: Array) -> list[tuple[int, int]]:
    """Those runs ``(start, stop)`` that follow one another at once, without a jump of the error.

    A controller crosses from one limit to the other in a sample only where the error jumps.
    """
    moves = np.abs(np.diff(error))
    usual = float(np.quantile(moves, _USUAL))
    found = []
    for before, after in pairwise(runs):
        if before[1] == after[0] and moves[after[0] - 1] <= usual:
            found += [before, after]
    return found


def in_long_runs(values: Array, least: int) -> Mask:
    """Samples that lie in a run of one value of at least ``least`` samples."""
    found = np.zeros(values.size, dtype=bool)
    for start, stop in runs_of(np.diff(values) == 0.0):
        if stop - start + 1 >= least:
            found[start : stop + 1] = True
    return found


def limits_of(
    op: Array,
    error: Array,
    controller: Controller | None,
    by_hand: Mask,
    settings: Facts,
    period: float = 1.0,
    usable: Mask | None = None,
) -> Limits:
    """Where OP is held at its highest or lowest value; only ``usable`` samples count.

    With a known controller a limit is where it would have moved OP further outwards and OP stayed;
    without one it is where OP stays at an extreme for long. OP that moves in steps must be held
    there (`estimator.diagnosis.standing`).
    """
    found = np.zeros(op.size, dtype=bool)
    # what bridges a hole, at the ends of a record above all, stands still and is not OP
    read = np.ones(op.size, dtype=bool) if usable is None else usable
    sides = []
    span = float(np.ptp(op))
    if span == 0.0:
        return Limits(0.0, 0.0, False, False, math.nan, found)
    runs = held_runs(op, error, controller, period, settings)
    in_steps = moves_in_steps(op, settings)
    for side, extreme in ((1.0, op.max()), (-1.0, op.min())):
        at = (np.abs(op - extreme) <= 1e-6 * span) & ~by_hand
        stays = at & read
        stays &= np.concatenate([[False], stays[:-1]])
        if not stays.any():
            sides.append(False)
            continue
        # nothing but a limit or a hand holds OP for long at its extreme
        is_limit = any(at[start:stop].all() for start, stop in runs)
        if in_steps and not is_limit:
            stays &= False
        if controller is not None:
            # held with the error pushing outwards for most of the time
            outward = stays & (side * _push(op, error, controller, at) > 0.0)
            is_limit |= bool(outward.sum() > settings.pushed * stays.sum())
        held = stays if is_limit and stays.mean() > settings.least_limit else np.zeros_like(stays)
        if held.any() and controller is not None:
            pushed = side * _push(op, error, controller, at) > 0.0
            held |= _thrown_off(at & read, pushed & read & ~by_hand, settings.least_run)
        sides.append(bool(held.any()))
        found |= held
    whole = float(np.sum(error**2))
    cost = float(np.sum(error[found] ** 2)) / whole if whole > 0.0 else 0.0
    value = float(np.median(op[found])) if found.any() else math.nan
    return Limits(float(found.mean()), cost, sides[0], sides[1], value, found)


def _thrown_off(at: Mask, pushed: Mask, most: int) -> Mask:
    """Samples off a limit, ``(n,)``, fewer than ``most`` in a row, that the error does not ask for.

    Noise moves OP off its limit where the controller adds increments; with the error ``pushed``
    outwards all the time it is back at once, and as much at its limit as where it stays there.
    """
    found = np.zeros(at.size, dtype=bool)
    for before, after in pairwise(np.flatnonzero(at)):
        if 1 < after - before <= most and pushed[before : after + 1].all():
            found[before : after + 1] = True
    return found


def _push(op: Array, error: Array, controller: Controller, at: Mask) -> Array:
    """Which way the error pushes an OP that is at an extreme, ``(n,)``: above zero upwards.

    A controller that integrates moves OP as long as there is an error; without integral action OP
    has one place for every error, known from where it is free.
    """
    if controller.integral_rate:
        return math.copysign(1.0, controller.integral_rate) * error
    if at.all():
        return np.zeros(op.size)
    wanted = controller.gain * error
    place: Array = wanted + float(np.median((op - wanted)[~at])) - op
    return place


def span_of(op: Array) -> float:
    """Span of an OP ``(n,)`` whose range nobody told: 1 where it lies between 0 and 1, else 100."""
    return 1.0 if float(op.min()) >= 0.0 and float(op.max()) <= 1.0 else USUAL_OP_SPAN


def sensor_of(
    pv: Array,
    error: Array,
    controller: Controller | None,
    usable: Mask,
    settings: Facts,
    *,
    op_span: float = USUAL_OP_SPAN,
) -> Sensor:
    """What PV itself tells about its sensor; only ``usable`` samples count."""
    y = pv[usable]
    if y.size < settings.least_run:
        # too few samples to judge: PV that was not read does not show a fault of its sensor
        return Sensor(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(pv.size, dtype=bool))
    if float(np.ptp(y)) == 0.0:
        return Sensor(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, usable)
    e = error[usable]
    deviation = max(float(np.std(e)), 1e-12 * max(1.0, float(np.abs(y).max())))
    still = in_long_runs(y, max(settings.least_run, int(settings.run_share * y.size)))
    levels = np.unique(y)
    coarse = levels.size < settings.levels
    step = float(np.median(np.diff(levels))) if coarse and levels.size > 1 else 0.0
    if coarse and step > 0.0:
        # few levels explain runs of one value
        still = in_long_runs(y, max(settings.least_run, y.size // 4))
    spikes, rest = find_spikes(y, deviation)
    cost = float(np.sum(rest[spikes] ** 2)) / max(float(np.sum((e - e.mean()) ** 2)), 1e-300)
    noise = _noise(y)
    where = np.zeros(pv.size, dtype=bool)
    where[usable] = still
    gain = abs(controller.gain) if controller is not None else 0.0
    return Sensor(
        frozen=float(still.mean()),
        step=step / deviation,
        spikes=float(spikes.mean()),
        spike_cost=min(1.0, cost),
        noise=noise,
        noise_share=min(1.0, (noise / deviation) ** 2),
        shaken=gain * noise / op_span,
        still=where,
    )


def _noise(y: Array) -> float:
    """Deviation of what third differences hold: white noise, a smooth course taken off."""
    if y.size < 8:
        return 0.0
    third = np.diff(y, 3)
    # white noise of deviation 1 has third differences of variance 20
    return float(np.median(np.abs(third))) / 0.6745 / math.sqrt(20.0)
