"""The transmitter of PV, and what can be wrong with it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fieldlink.lab.rehearse.happenings import SensorFault

__all__ = ["Transmitter"]


class Transmitter:
    """Turns the true PV into the measured one.

    Args:
        faults: what is wrong when; where they overlap, each acts on what the one before gives.
        seed: of spikes and noise.
    """

    def __init__(self, faults: Sequence[SensorFault], seed: int) -> None:
        self._faults = tuple(faults)
        self._random = np.random.default_rng(seed)
        self._frozen: dict[int, float] = {}

    def measure(self, time: float, pv: float) -> float:
        """Return what is measured at ``time``; to be called once a scan, in order."""
        for number, fault in enumerate(self._faults):
            if not fault.covers(time):
                self._frozen.pop(number, None)
            elif fault.kind == "freeze":
                pv = self._frozen.setdefault(number, pv)
            elif fault.kind == "drift":
                pv += fault.rate * (time - fault.begin)
            elif fault.kind == "spikes":
                hit, sign = self._random.random(2)
                pv += fault.size * math.copysign(hit < fault.share, sign - 0.5)
            elif fault.kind == "noise":
                pv += fault.size * self._random.standard_normal()
            else:
                pv = math.nan
        return pv
