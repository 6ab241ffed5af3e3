"""Which noise and which friction the loop has: a tracker for each, of which the likeliest counts.

Noise that passes through the process (equation noise, as in (7)) is carried on in the prediction;
white noise of the measurement is not. A filter made for the one chases the other or lags behind
it, and no block says which it is. So a `StemTracker` runs for each of a few `NoiseModel`s, each
scales its noise itself, and the densities they gave to the PV that came decide between them.

The same is asked of the friction. A valve that sticks a quarter more than its block says misses
moves that are sure to slip, and one tracker explains each miss by load, by gain, by fD: it never
learns from all of them together. A tracker that has had the larger friction from the start does.
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


def noise_kinds(prediction: Prediction) -> tuple[NoiseModel, ...]:
    """Return the noise models that a process may have: no tank's level is a random walk."""
    return NOISE_KINDS[1:] if prediction.process.is_integrating else NOISE_KINDS


class TrackerBank:
    """One tracker a noise model and friction; `chosen` is the one to believe.

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
        self._settings = settings
        self._frictions = [factor for factor in settings.frictions for _ in noises]
        self._trackers = [
            StemTracker(prediction, _scaled(valve, factor), replace(settings, noise=noise))
            for factor in settings.frictions
            for noise in noises
        ]
        self._scores = [0.0] * len(self._trackers)
        self._claims = [0.0 if factor == 1.0 else settings.claim for factor in self._frictions]
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
        for tracker, factor in zip(self._trackers, self._frictions, strict=True):
            tracker.valve = _scaled(valve, factor)

    def observe(self, pv: float, op: float) -> None:
        """Take in one scan; see `StemTracker.observe`."""
        keep = 1.0 - 1.0 / self._settings.bank_memory
        for i, tracker in enumerate(self._trackers):
            tracker.observe(pv, op)
            self._scores[i] = keep * self._scores[i] + tracker.innovations.evidence
        self._count += 1
        if self._count <= self._settings.bank_learning:
            self._scores = [0.0] * len(self._trackers)
        # Where a model of too low an order leaves innovations correlated, each tells less.
        colour = self.chosen.innovations.colour
        worth = (1.0 - colour) / (1.0 + colour)
        scores = [
            worth * score - claim for score, claim in zip(self._scores, self._claims, strict=True)
        ]
        best = max(range(len(scores)), key=scores.__getitem__)
        if scores[best] > scores[self._chosen] + self._settings.lead:
            self._chosen = best


def _scaled(valve: ValveModel, factor: float) -> ValveModel:
    """Return a valve with ``factor`` times the friction."""
    return ValveModel(factor * valve.stick_band, factor * valve.slip_jump)
