"""The alternative of a disturbance from outside: a healthy valve and a sinusoid in PV.

A sinusoidal load makes OP and PV sinusoids whose gain and phase are the controller's, not the
process's. Where a set-point step shows the true process as well, no process with a healthy valve
fits both, and a sticky valve, which shifts phase, may fit better. A valve's slips have harmonics
though, and a sinusoid has none: given the sinusoid as an alternative with as many parameters as the
valve (frequency, amplitude, phase), each wins where it is true.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array
from estimator._slips import Op
from estimator.candidate import Candidate
from estimator.regression import Regression
from estimator.search import healthy_refined, healthy_search

__all__ = ["Outside", "outside_search"]

_AROUND = (-0.6, -0.3, 0.3, 0.6)
_FINER = (-0.15, 0.15)
"""Frequencies tried around the peak of OP's spectrum, in its bins."""
_NEAR = 0.3
"""How far the process moves from one frequency to the next, in the logarithm of time constants."""


@dataclass(frozen=True, slots=True)
class Outside:
    """The best process with a healthy valve beside the best sinusoid."""

    process: Candidate
    regression: Regression


def outside_search(op: Op, regression: Regression) -> Outside:
    """The best sinusoid near the peak of OP's spectrum, and the process that goes with it."""
    peak = _peak(op.u)
    best = _with_sinusoid(regression, peak)
    found = Outside(healthy_search(op, best), best)
    centre = peak
    for offsets in (_AROUND, _FINER):
        nearest = centre
        for offset in offsets:
            other = _with_sinusoid(regression, centre + offset)
            process = healthy_refined(op, other, found.process, _NEAR, 2)
            if process.cost < found.process.cost:
                found, nearest = Outside(process, other), centre + offset
        centre = nearest
    process = healthy_refined(op, found.regression, found.process, _NEAR, 4)
    return Outside(process, found.regression)


def _peak(u: Array) -> float:
    """Bin of the highest peak of the spectrum, between bins."""
    windowed = (u - u.mean()) * np.hanning(u.size)
    power = np.abs(np.fft.rfft(windowed))
    k = 1 + int(power[1:-1].argmax())
    left, middle, right = power[k - 1], power[k], power[min(k + 1, power.size - 1)]
    bend = left - 2.0 * middle + right
    return k + (0.5 * float((left - right) / bend) if bend < 0.0 else 0.0)


def _with_sinusoid(regression: Regression, cycles: float) -> Regression:
    angle = 2.0 * np.pi * cycles * np.arange(regression.size) / regression.size
    columns = np.stack([np.sin(angle), np.cos(angle)])
    return Regression(regression.y, regression.good, regression.taps, regression.min_lag, columns)
