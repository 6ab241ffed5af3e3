"""Which kind of noise the loop has: one tracker for each kind, of which the likelier one counts.

Noise that passes through the process (equation noise, as in (7)) is carried on in the prediction;
white noise of the measurement is not. A filter made for the one chases the other or lags behind
it, and no block says which it is. So a `StemTracker` runs for each of a few `NoiseModel`s, each
scales its noise itself, and the densities they gave to the PV that came decide between them.
"""

from __future__ import annotations

from dataclasses import replace

from compensator.prediction import NoiseModel, Prediction
from compensator.stem import StemTracker
from compensator.tracker_settings import TrackerSettings
from loop_model import ValveModel

__all__ = ["NOISE_KINDS", "TrackerBank", "noise_kinds"]

NOISE_KINDS = (
    NoiseModel(equation=1.0, measurement=0.3, disturbance=1.0),
    NoiseModel(equation=0.1, measurement=1.0, disturbance=1.0),
)
"""Noise through the process, and noise of the measurement (also the choice that forgives a process
model of too low an order). The filter's ``disturbance`` is set by `TrackerSettings.offset_memory`.
"""

_MEMORY = 120.0
_LEAD = 4.0
_LEARNING = 60
"""Scans in which a tracker still learns how much noise there is: what it expects counts nothing."""


def noise_kinds(prediction: Prediction) -> tuple[NoiseModel, ...]:
    """Return the noise models that a process may have: no tank's level is a random walk."""
    return NOISE_KINDS[1:] if prediction.process.is_integrating else NOISE_KINDS


class TrackerBank:
    """One tracker a noise model; `chosen` is the one to believe.

    Args:
        prediction: the process with its disturbance at the input.
        valve: the valve model.
        settings: of the trackers; its ``noise`` is replaced.
        noises: the candidates, at least one. Until the data speak the first one counts.
    """

    def __init__(
        self,
        prediction: Prediction,
        valve: ValveModel,
        settings: TrackerSettings,
        noises: tuple[NoiseModel, ...],
    ) -> None:
        self._trackers = [
            StemTracker(prediction, valve, replace(settings, noise=noise)) for noise in noises
        ]
        self._scores = [0.0] * len(noises)
        self._chosen = 0
        self._count = 0

    @property
    def chosen(self) -> StemTracker:
        """The tracker whose noise model fits the data best."""
        return self._trackers[self._chosen]

    @property
    def noise(self) -> NoiseModel:
        """The noise model that the data support."""
        return self.chosen.settings.noise

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters."""
        for tracker in self._trackers:
            tracker.valve = valve

    def observe(self, pv: float, op: float) -> None:
        """Take in one scan; see `StemTracker.observe`."""
        keep = 1.0 - 1.0 / _MEMORY
        for i, tracker in enumerate(self._trackers):
            tracker.observe(pv, op)
            self._scores[i] = keep * self._scores[i] + tracker.innovations.evidence
        self._count += 1
        if self._count <= _LEARNING:
            self._scores = [0.0] * len(self._trackers)
        best = max(range(len(self._scores)), key=self._scores.__getitem__)
        if self._scores[best] > self._scores[self._chosen] + _LEAD:
            self._chosen = best
