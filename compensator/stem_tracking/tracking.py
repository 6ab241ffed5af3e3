"""Which noise and which valve the loop has: a tracker for each, of which the likeliest counts.

Noise that passes through the process (equation noise, as in (7)) is carried on in the prediction;
white noise of the measurement is not. A filter made for the one chases the other or lags behind
it, and no block says which it is. So a `StemTracker` runs for each of a few `NoiseModel`s, each
scales its noise itself, and the densities they gave to the PV that came decide between them.

The same is asked of the friction. A valve that sticks a quarter more than its block says misses
moves that are sure to slip, and one tracker explains each miss by load, by gain, by fD: it never
learns from all of them together. A tracker that has had the larger friction from the start does.

And of the slip jump. A limit cycle at one set-point shows the product of J and the process gain, so
that a block may state a J of 6 between 1 and 12 where it is 3, with half the gain. What one tracker
can learn ends at some 30 %; beyond it trackers of other slip jumps, with the gain that keeps the
product, stand ready as far as the block's interval reaches.

And of the dead time. A controller that expects the answer of its move too early moves again before
it comes, and a wrong dead time is what identification makes of lags that the model lacks. A tracker
of a longer one makes it wait. One that expects it too late takes the answer for a load that comes
against it, moves back, and sees another load when the first answer is due: trackers of shorter dead
times know it for what it is.

A limit cycle leaves J and dead time open together: a stem of small J goes along with OP bit by bit,
one of larger J slips at once, and being so much later makes up for a dead time that is too short.
So each larger slip jump has trackers of longer dead times as well.

And of the gain. Where PV answers twice as much as the model has it, each move goes too far, and its
way back as well. A load that comes and goes beside a move looks the same: while a tracker holds
that a load has stepped, PV speaks for no other gain.

And of the gain's sign: a model of the wrong one moves PV away, takes that for load, and moves on. A
tracker of the other sign is never acted upon. Where PV bears it out, the model is contradicted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from compensator.prediction import NoiseModel, Prediction
from compensator.stem_tracking.stem import StemTracker
from compensator.stem_tracking.tracker_settings import TrackerSettings
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


@dataclass(frozen=True, slots=True)
class _Kind:
    """What the loop may be, by its difference from the model.

    Attributes:
        friction: factor of S and J.
        jump: factor of J alone; the gain is the larger by it.
        claim: log-odds against it.
        late: samples by which PV answers later than the model has it, or sooner where negative.
        load_walk: of the load (`TrackerSettings.load_walk`).
        gain: factor of the gain alone.
    """

    friction: float
    jump: float
    claim: float
    late: int = 0
    load_walk: float = 0.0
    gain: float = 1.0

    def of(self, valve: ValveModel) -> ValveModel:
        """Return the valve, given the model's."""
        band = self.friction * valve.stick_band
        return ValveModel(band, min(self.friction * self.jump * valve.slip_jump, band))


class TrackerBank:
    """One tracker a noise model and valve; `chosen` is the one to believe.

    Args:
        prediction: the process with its disturbance at the input.
        valve: the valve model.
        settings: of the trackers; its ``noise`` is replaced.
        noises: the candidates, at least one. Until the data speak the first one counts.

    Attributes:
        trackers: of the model's own valve and every noise first.
        predictions: of the process, by the samples that PV answers later than the model has it.
    """

    def __init__(
        self,
        prediction: Prediction,
        valve: ValveModel,
        settings: TrackerSettings,
        noises: tuple[NoiseModel, ...],
    ) -> None:
        self._settings, self._noises = settings, len(noises)
        settles = not prediction.process.is_integrating
        kinds = _possible_kinds(valve, settings, prediction.dead_time, settles=settles)
        self._kinds = [kind for kind in kinds for _ in noises]
        self.predictions = predictions = {k.late: _later(prediction, k.late) for k in kinds}
        self.trackers = [
            StemTracker(
                predictions[kind.late],
                kind.of(valve),
                replace(
                    settings,
                    noise=noise,
                    gain=settings.gain * kind.gain / kind.jump,
                    load_walk=max(settings.load_walk, kind.load_walk),
                ),
            )
            for kind in kinds
            for noise in noises
        ]
        self._scores = [0.0] * len(self.trackers)
        turned = _turned(prediction)
        self._turned = [
            StemTracker(turned, valve, replace(settings, noise=noise)) for noise in noises
        ]
        self._turned_scores = [0.0] * len(noises)
        self._opposition = 0.0
        self._chosen = 0
        self._count = 0

    @property
    def chosen(self) -> StemTracker:
        """The tracker that fits the data best."""
        return self.trackers[self._chosen]

    @property
    def noise(self) -> NoiseModel:
        """The noise model that the data support."""
        return self.chosen.settings.noise

    @property
    def opposed(self) -> bool:
        """Whether PV answers to the stem against the sign of the model's gain."""
        return self._opposition > self._settings.opposed_claim

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters."""
        for tracker, kind in zip(self.trackers, self._kinds, strict=True):
            tracker.valve = kind.of(valve)
        for tracker in self._turned:
            tracker.valve = valve

    def observe(self, pv: float, op: float) -> None:
        """Take in one scan; see `StemTracker.observe`."""
        keep = 1.0 - 1.0 / self._settings.bank_memory
        for tracker in self.trackers:
            tracker.observe(pv, op)
        for i, tracker in enumerate(self.trackers):
            heard = tracker
            if self._kinds[i].gain != 1.0 and tracker.is_unsettled:
                heard = self.trackers[i % self._noises]  # the model itself, with the same noise
            self._scores[i] = keep * self._scores[i] + heard.innovations.evidence
        for i, tracker in enumerate(self._turned):
            tracker.observe(pv, op)
            self._turned_scores[i] = keep * self._turned_scores[i] + tracker.innovations.evidence
        self._count += 1
        if self._count <= self._settings.bank_learning:
            self._scores = [0.0] * len(self.trackers)
            self._turned_scores = [0.0] * len(self._turned)
        # Where a model of too low an order leaves innovations correlated, each tells less.
        colour = self.chosen.innovations.colour
        worth = (1.0 - colour) / (1.0 + colour)
        scores = [
            worth * score - kind.claim
            for score, kind in zip(self._scores, self._kinds, strict=True)
        ]
        best = max(range(len(scores)), key=scores.__getitem__)
        if scores[best] > scores[self._chosen] + self._settings.lead:
            self._chosen = best
        self._opposition = worth * max(self._turned_scores) - scores[best]


def _later(prediction: Prediction, samples: int) -> Prediction:
    """Return the prediction of a process whose dead time is longer, or shorter where negative."""
    if samples == 0:
        return prediction
    process = prediction.process
    return Prediction.of(replace(process, dead_time=process.dead_time + samples), "input")


def _turned(prediction: Prediction) -> Prediction:
    """Return the prediction of a process that answers to the stem the other way round."""
    process = prediction.process
    turned = replace(process, b=tuple(-b for b in process.b), offset=-process.offset)
    return Prediction.of(turned, "input")


def _jump_factors(valve: ValveModel, settings: TrackerSettings) -> list[float]:
    """Return the factors of the slip jump that are looked at: the settings', and from the largest
    of them on twice as much each, up to the stick band.
    """
    factors = list(settings.jumps)
    if not factors or valve.slip_jump <= 0.0:
        return factors
    factor = max(factors)
    while factor > 1.0 and 2.0 * factor * valve.slip_jump <= valve.stick_band:
        factor *= 2.0
        factors.append(factor)
    least = settings.least_jump * valve.stick_band
    return [factor for factor in factors if factor * valve.slip_jump >= least]


def _possible_kinds(
    valve: ValveModel, settings: TrackerSettings, dead_time: int, *, settles: bool
) -> list[_Kind]:
    """Return what has trackers, the model itself first.

    The load of a level, which does not settle, shows in PV's slope alone. Coloured noise of its
    measurement, as waves make it, would pass for a load that does not rest.
    """
    kinds = [
        _Kind(factor, 1.0, 0.0 if factor == 1.0 else settings.claim)
        for factor in settings.frictions
    ]
    for factor in _jump_factors(valve, settings):
        price = settings.friction.price_of_jump(valve, factor)
        if price <= settings.claim and factor * valve.slip_jump <= valve.stick_band:
            kinds.append(_Kind(1.0, factor, price))
            later = settings.jump_late if settles and factor > 1.0 else ()
            kinds += [_Kind(1.0, factor, price + settings.jump_late_claim, late) for late in later]
    kinds += [_Kind(1.0, 1.0, settings.claim, gain=factor) for factor in settings.gains]
    kinds += [
        _Kind(1.0, 1.0, settings.late_claim, late) for late in settings.late if late > -dead_time
    ]
    kinds += [
        _Kind(1.0, 1.0, settings.restless_claim, load_walk=walk)
        for walk in settings.restless
        if settles
    ]
    return kinds
