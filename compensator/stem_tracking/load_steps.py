"""A step of the load is told from wrong friction by the innovations of PV.

A wrong friction or gain shows after a move of the stem; a load shows at any time, with innovations
of one sign that are far beyond the noise. What the load has made of PV since it came is then spread
over the process's states: the filter has to widen its belief along that signature, otherwise it
explains the states by a load many times too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.action import require_positive, require_whole
from compensator.kernels import next_state
from compensator.prediction import Prediction

__all__ = ["LoadStepDetector", "LoadStepSettings", "load_signature"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LoadStepSettings:
    """Settings of `LoadStepDetector`.

    Attributes:
        beyond: deviations of an innovation that noise does not reach: 4 is exceeded by one normal
            value in 16,000.
        count: successive innovations of one sign beyond it that make a step.
        same: deviations from which innovations of one sign count as one run.
        pause: scans, beside the dead time, between a step and the next.
        longest: scans of a run up to which a load is looked for.
        size: of a load step that the belief is widened for, as a share of the static friction.
    """

    beyond: float = 4.0
    count: int = 3
    same: float = 1.0
    pause: int = 5
    longest: int = 20
    size: float = 1.0

    def __post_init__(self) -> None:
        require_positive("LoadStepSettings", beyond=self.beyond, same=self.same, size=self.size)
        require_whole("LoadStepSettings", 1, count=self.count, longest=self.longest)
        require_whole("LoadStepSettings", 0, pause=self.pause)


class LoadStepDetector:
    """Finds load steps in the normalised innovations of a filter, one `push` a scan."""

    def __init__(self, dead_time: int, settings: LoadStepSettings | None = None) -> None:
        self.settings = settings or LoadStepSettings()
        self._dead_time = dead_time
        self._sign = 0.0
        self._run = self._beyond = 0
        self._since = 0

    def push(self, normal: float, *, is_biased: bool) -> int:
        """Take in an innovation in deviations; return scans since a load step, 0 for none.

        Args:
            normal: the innovation.
            is_biased: whether innovations have kept one sign for too long.
        """
        s = self.settings
        sign = math.copysign(1.0, normal)
        goes_on = sign == self._sign and abs(normal) > s.same
        self._run = self._run + 1 if goes_on else 1
        self._beyond = self._beyond + 1 if goes_on and abs(normal) > s.beyond else 0
        self._sign = sign
        self._since += 1
        jumped = self._beyond >= s.count and self._since > self._dead_time + s.pause
        if not (jumped or (is_biased and self._since > s.pause)):
            return 0
        self._since = self._beyond = 0
        return self._dead_time + min(self._run, s.longest)


def load_signature(prediction: Prediction, scans: int) -> Array:
    """Return what a unit load that came ``scans`` ago has made of the states, shape ``(n,)``."""
    state = np.zeros(prediction.order)
    for _ in range(scans):
        state = next_state(prediction.A, state) + prediction.B
    return state
