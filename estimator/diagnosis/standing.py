"""OP that stands still for long: held by a hand or a limit, or no step away from what is wanted.

OP of a three-point actuator, of a controller with an output dead band, and of a historian that
stores by exception moves in steps: it stands still all the time, for as long as the controller
wants it less than a step away. Held it is where the controller would have moved it further.

A controller with a gap leaves OP where it is while the error is within it: the size of the error
tells when OP stands still, which no hand and no limit do.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array, Mask
from estimator.controller.controller import Controller
from estimator.diagnosis.settings import Facts
from estimator.faults import runs_of

__all__ = ["gap_of", "held_runs", "mask_of", "moves_in_steps"]

_LOOKS = 8
"""Looks at how often OP repeats itself, each without the runs that the one before found."""
_TRIMMED = 4.0
"""Robust deviations beyond which a move is none of the controller's."""


def moves_in_steps(op: Array, settings: Facts) -> bool:
    """Whether OP ``(n,)`` stands still after most of its moves."""
    moves = np.diff(op) != 0.0
    count = int(moves[:-1].sum())
    return count > 0 and float(np.mean(~moves[1:][moves[:-1]])) > settings.in_steps


def held_runs(
    op: Array, error: Array, controller: Controller | None, period: float, settings: Facts
) -> list[tuple[int, int]]:
    """First sample, and the one behind the last, of the long runs of one value that are no chance.

    Signals are ``(n,)`` each. A controller that is known, by its settings or by the moves that OP
    did make, must have wanted to move OP by several of its usual moves. Where none is known, OP
    that moves in steps must stand still for longer than by chance.
    """
    least = max(settings.least_run, int(settings.run_share * op.size))
    runs = [(start, stop + 1) for start, stop in runs_of(np.diff(op) == 0.0)]
    runs = [(start, stop) for start, stop in runs if stop - start >= least]
    moves = np.abs(np.diff(op))
    if not moves.any() or not runs:
        return runs
    if math.isfinite(gap_of(op, error, settings)):
        return []
    laws = _laws(op, error, controller, period, least, settings)
    if laws:
        usual = settings.steps * float(np.median(moves[moves > 0.0]))
        return [
            (start, stop)
            for start, stop in runs
            if max(_asked(error[start:stop], *law) for law in laws) > usual
        ]
    if moves_in_steps(op, settings):
        least = max(least, _by_chance(op, least, settings))
    return [(start, stop) for start, stop in runs if stop - start >= least]


def gap_of(op: Array, error: Array, settings: Facts) -> float:
    """The size of the error up to which OP stands still and beyond which it moves, units of PV.

    NaN where OP stands still and moves with errors of the same size, or stands still without any.
    Signals are ``(n,)`` each.
    """
    # a controller moves on the error of this sample and of the last one
    size = np.maximum(np.abs(error[1:]), np.abs(error[:-1]))
    moved = np.diff(op) != 0.0
    # a PV of coarse resolution is at its set-point for a while: every controller keeps still then
    still = ~moved & (size > 0.0)
    if min(int(moved.sum()), int(still.sum())) < settings.least_run:
        return math.nan
    within = float(np.quantile(size[still], 1.0 - settings.of_gap))
    beyond = float(np.quantile(size[moved], settings.of_gap))
    return beyond if within <= beyond else math.nan


def _asked(error: Array, gain: float, integral: float) -> float:
    """How far a controller would have moved OP about where it began."""
    return float(np.ptp(gain * (error - error[0]) + integral * np.cumsum(error)))


def _laws(
    op: Array,
    error: Array,
    controller: Controller | None,
    period: float,
    least: int,
    settings: Facts,
) -> list[tuple[float, float]]:
    """Gain and integral gain of a sample: as read off sums of the record, and off OP's moves."""
    found = []
    if controller is not None and controller.integral_rate:
        found.append((controller.gain, controller.integral_rate * period))
    at = np.flatnonzero(np.diff(op)) + 1
    # at a move OP is where the controller wants it, unless a hand held it before
    sums, free = np.cumsum(error), np.diff(at) < least
    if int(free.sum()) < settings.least_moves:
        return found
    moves = np.diff(op[at])[free]
    rows = np.stack([np.diff(error[at])[free], np.diff(sums[at])[free]], axis=1)
    used = np.ones(moves.size, dtype=bool)
    for _ in range(_LOOKS):
        law = np.linalg.lstsq(rows[used], moves[used], rcond=1e-10)[0]
        left = np.abs(moves - rows @ law)
        now = left <= _TRIMMED / 0.6745 * float(np.median(left[used]))
        if (now == used).all() or not now.any():
            break
        used = now
    whole = float(moves[used] @ moves[used])
    explains = float(left[used] @ left[used]) < (1.0 - settings.of_moves) * whole
    if explains and law[0] * law[1] > 0.0:
        found.append((float(law[0]), float(law[1])))
    return found


def _by_chance(op: Array, least: int, settings: Facts) -> int:
    """Samples for which OP seldom stands still by chance, as often as it does among other runs.

    Runs at OP's extremes do not count among these: a limit may hold OP.
    """
    same = np.diff(op) == 0.0
    inside = ((op > op.min()) & (op < op.max()))[1:]
    runs = runs_of(same & inside)
    lengths = np.array([stop - start for start, stop in runs], dtype=np.int64)
    is_held = np.zeros(lengths.size, dtype=bool)
    bound = least
    for _ in range(_LOOKS):
        held = int(lengths[is_held].sum())
        repeats = (int((same & inside).sum()) - held + 1) / (int(inside.sum()) - held + 2)
        bound = max(least, math.ceil(math.log(settings.chance / op.size) / math.log(repeats)))
        now = lengths >= bound
        if (now == is_held).all():
            break
        is_held = now
    return bound


def mask_of(runs: list[tuple[int, int]], n: int) -> Mask:
    """The samples of runs, ``(n,)``."""
    found: Mask = np.zeros(n, dtype=bool)
    for start, stop in runs:
        found[start:stop] = True
    return found
