"""Samples of PV that are not the process's: spikes, a value that stands still, marks for no value.

The controller answers a spike, and OP winds up while PV stands still: both look like a process that
does not follow OP, which a sticky valve explains well. So such samples are no samples at all.

A run of one value is a fault in a record that seldom stays at a value. A record that often does (a
coarse resolution, a historian that stores by exception) has long runs where PV turns: there a run
must be longer than comes by chance, and PV must leave the value with a jump.

A mark is one number, such as -9999, that a recorder stores where it has none.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from estimator.arrays import Array, Mask
from estimator.settings import Screening
from estimator.window import bridge

__all__ = ["faults_of", "find_marks", "find_spikes", "find_standing", "runs_of"]

_TURNS = 8
"""Looks at a record, each without the spikes, or runs of one value, that the one before found."""
_AROUND = 5
"""Samples of the running median: a spike of one or two is not in it, a step is."""
_SPIKE = 10.0
"""Deviations from the running median from which a sample is a spike (tuning family, which has none:
at six deviations one record of seven seems to have some)."""
_SHARE = 0.05
"""Largest share of samples that are spikes: what comes more often is the signal's own."""
_TO_DEVIATION = 1.96
"""Deviations of a normal distribution that this share lies beyond."""
_LEAST_NOISE = 0.03
"""Least noise of the running median's rest, as a share of the signal's deviation."""
_STEPS, _QUICK = 3.0, 0.9
"""Quick steps of a record by which a spike is off, and the share of steps that are smaller than a
quick one: the corner of a wave without noise is off by two, and a record that is held has no noise
but steps."""
_JUMP = 3.0
"""Usual steps by which PV leaves a value at which it stood still: nothing moves it so far in one
sample."""
_SELDOM, _LEAST_RUN = 0.02, 8
"""Share of its samples after which a record stays at a value, below which it stays there seldom;
repeats in a row that are a fault in such a record."""
_BESIDE, _APART = 50, 5.0
"""Other samples that there must be, and times that the span of these is as wide as their distance
from a mark."""
_CHANCE = 1e-3
"""Records in which a run comes by chance that is taken for a fault."""


def faults_of(pv: Array, settings: Screening) -> Mask:
    """Which samples of PV ``(n,)`` are faults of the sensor; NaN, a missing sample, is none."""
    known = np.isfinite(pv)
    found = np.zeros(pv.size, dtype=np.bool_)
    if int(known.sum()) < settings.min_samples or np.ptp(pv[known]) == 0.0:
        return found
    found[known] = find_marks(pv[known])
    known &= ~found
    found[known] = find_standing(pv[known])
    moving = known & ~found
    if int(moving.sum()) < settings.min_samples:
        return found
    bridged = bridge(np.where(moving, pv, math.nan))
    spikes, _ = find_spikes(bridged, float(np.std(pv[moving])))
    return found | (spikes & moving)


def runs_of(where: Mask) -> list[tuple[int, int]]:
    """First sample of each run of true samples, and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def find_marks(values: Array) -> Mask:
    """Samples in ``(n,)`` that have the one lowest or highest value, far from all others."""
    found = np.zeros(values.size, dtype=np.bool_)
    for extreme in (float(values.min()), float(values.max())):
        others = values[~found & (values != extreme)]
        if others.size < _BESIDE or np.ptp(others) == 0.0:
            continue
        apart = float(np.abs(others - extreme).min())
        found |= (values == extreme) & (apart > _APART * float(np.ptp(others)))
    return found


def _running_median(values: Array) -> Array:
    found: Array = scipy.ndimage.median_filter(values, size=_AROUND, mode="nearest")
    return found


def find_spikes(values: Array, deviation: float) -> tuple[Mask, Array]:
    """Spikes of one or two samples in ``(n,)``, and what the running median leaves, ``(n,)``.

    Args:
        values: finite samples.
        deviation: of what the loop does, in the same units.
    """
    rest = values - _running_median(values)
    noise = float(np.quantile(np.abs(rest), 1.0 - _SHARE)) / _TO_DEVIATION
    steps = np.abs(np.diff(values))
    quick = float(np.quantile(steps[steps > 0.0], _QUICK)) if steps.any() else 0.0
    least = max(_SPIKE * max(noise, _LEAST_NOISE * deviation), _STEPS * quick)
    spikes = np.zeros(values.size, dtype=np.bool_)
    for _ in range(_TURNS):
        before = int(spikes.sum())
        for begin, end in runs_of((np.abs(rest) > least) & ~spikes):
            # a spike comes back: what stays away is a step
            spikes[begin:end] = end - begin <= _AROUND // 2
        if int(spikes.sum()) == before:
            break
        # of spikes that are close to each other the median takes some for what the loop does
        rest = values - _running_median(bridge(np.where(spikes, math.nan, values)))
    return spikes, rest


def find_standing(values: Array) -> Mask:
    """Samples in ``(n,)`` at which the sensor repeats its last value; the first one is a sample."""
    n = values.size
    steps = np.abs(np.diff(values))
    same = steps == 0.0
    runs = np.array(runs_of(same), dtype=np.int64).reshape(-1, 2)
    begins, ends = runs[:, 0], runs[:, 1]
    usual = float(np.median(steps[~same])) if (~same).any() else 0.0
    leaves = np.where(ends < n - 1, steps[np.minimum(ends, n - 2)], np.inf)
    jumps = leaves > _JUMP * usual
    # at its end of range a transmitter has only one value, at which PV belongs
    inside = (values[begins] > values.min()) & (values[begins] < values.max())
    lengths = ends - begins
    # of the times that PV could have stayed, how often it did
    seldom = begins.size < _SELDOM * (begins.size + int((~same).sum()))
    is_fault = inside & (lengths >= _LEAST_RUN) & seldom
    for _ in range(0 if seldom else _TURNS):
        out = int(lengths[is_fault].sum())
        repeats = (int(same.sum()) - out + 1) / (n - 1 - out + 2)
        now = inside & jumps & (lengths >= math.log(_CHANCE / n) / math.log(repeats))
        if (now == is_fault).all():
            break
        is_fault = now
    found = np.zeros(n, dtype=np.bool_)
    for begin, end in zip(begins[is_fault], ends[is_fault], strict=True):
        found[begin + 1 : end + 1] = True
    return found
