"""Did a load drive PV out of its range, or did the compensator?

PV after a load step is the process's answer to that step and to what the stem did since. So the
step that fits PV best is found together with the answer to the stem as the model has it, without
it, and turned round. A load is the reason where that explains PV, and at least twice as well with
the answer as it is: with a wrong sign of the gain PV went the other way, and a stem that runs away
is no step.

Example: after steps of three stick bands on the tuning family, 0.001 to 0.01 of PV's variance is
left with the answer as it is, 0.02 to 0.4 without it; with a wrong sign and no load 0.03 to 1.3,
and less when it is turned round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from compensator.prediction import Prediction, answer_of
from compensator.supervising.figures import Sample
from loop_model import ValveModel

__all__ = ["explained_by_load"]

_LEAST = 8
"""Samples of PV that tell a step from an answer."""

Array = NDArray[np.float64]


def explained_by_load(
    samples: Sequence[Sample], since: int, prediction: Prediction, valve: ValveModel, left: float
) -> bool:
    """Return whether one step of the load explains the last ``since`` of some samples.

    Args:
        samples: the latest ones; those before ``since`` make the state of the process.
        since: samples in which the step must have come.
        prediction: the process.
        valve: the valve.
        left: largest share of PV's variance that may be left unexplained.
    """
    pv = np.array([s.pv for s in samples])[-since:]
    stem = valve.simulate([s.op for s in samples], samples[0].op)
    answer = _answer(stem - stem[0], prediction)[-since:]
    known = np.isfinite(pv)
    if known.sum() < _LEAST:
        return False
    pv, answer = pv[known], answer[known]
    step = _answer(np.ones(since), prediction)
    steps = [
        np.concatenate([np.zeros(start), step[: since - start]])[known]
        for start in range(since - 3)
    ]
    as_it_is, without, turned = (
        min(_misfit(pv - factor * answer, s) for s in steps) for factor in (1.0, 0.0, -1.0)
    )
    whole = float(np.var(pv))
    return as_it_is <= 0.5 * min(without, turned) and as_it_is <= left * whole


def _answer(drive: Array, prediction: Prediction) -> Array:
    """Return what the process makes of a drive, from rest."""
    return answer_of(prediction.process, drive, prediction.dead_time)


def _misfit(rest: Array, step: Array) -> float:
    """Return the mean square that a multiple of a step and a constant leave of a signal."""
    rest, step = rest - rest.mean(), step - step.mean()
    power = float(np.mean(step**2))
    share = float(np.mean(rest * step)) ** 2 / power if power > 0.0 else 0.0
    return max(0.0, float(np.mean(rest**2)) - share)
