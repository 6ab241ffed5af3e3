"""Where the stem stands: a few hypotheses, each with its own filter, judged by PV.

Between slips the stem is not visible, and whether a command near the static friction made it slip
depends on parameters that are known to some per cent only. So every such command leaves two
hypotheses, *it slipped* and *it stayed*. Each carries the process state that it implies; the
innovations of PV tell them apart within a few samples, and the better one is believed from then on
(a missed or an unexpected slip is re-synchronised that way). A certain slip makes all of them
agree: after it the position is ``OP -/+ fD``, whatever it was before. The friction that a slip
needs is taken as normal around fS; a hypothesis that has survived a command knows that it needs
more than that command.

What is wrong in the parameters is learnt with the state, as three more unknowns of the filter. What
drives the process is ``x + m + w d + g (x - x_ref)`` with ``m`` the load (the offset-free
disturbance), ``d`` the direction of the last slip, ``w`` the error of fD, which turns its sign with
the direction, and ``g`` the relative error of the gain. Their covariance is followed in time: fast
learning after an upset, and firm estimates later, so that the controller is free of offset and yet
does not chase noise. The covariance is that of the best hypothesis, the others share it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.prediction import NoiseModel, Prediction
from loop_model import ValveModel

__all__ = ["Belief", "StemTracker", "TrackerSettings"]

Array = NDArray[np.float64]

LOAD, FRICTION, GAIN = 0, 1, 2


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Settings of `StemTracker`.

    Attributes:
        noise: ratios of the filter; its ``disturbance`` is the slow drift in quiet times.
        spread: relative uncertainty of the static and dynamic friction.
        gain_spread: relative uncertainty of the process gain.
        timing: uncertainty of the process's dynamics, as the time (in samples) by which PV may
            come earlier or later than modelled: while PV is on its way after a move, that much of
            an innovation is the model's fault and teaches nothing.
        hypotheses: how many are kept.
        memory: samples over which evidence counts.
    """

    noise: NoiseModel
    spread: float = 0.1
    gain_spread: float = 0.1
    timing: float = 1.0
    hypotheses: int = 6
    memory: float = 60.0


@dataclass(slots=True)
class Belief:
    """One hypothesis.

    Attributes:
        stem: position by the model's equations; direction: of its last slip (0: unknown).
        state: of the process at this scan, shape ``(n,)``; errors: ``(m, w, g)``, see the module.
        noise: equation noise seen in this scan's PV, on its way into the next state.
        score: log-likelihood, forgetting.
        survived: largest command withstood since the last slip, in deviations of the static
            friction around fS (minus infinity: none near it).
    """

    stem: float
    direction: float
    state: Array
    errors: Array
    noise: float = 0.0
    score: float = 0.0
    survived: float = -math.inf


def _tail(z: float) -> float:
    """Return the probability that a normal variable exceeds ``z``."""
    return 0.5 * math.erfc(z / math.sqrt(2.0))


class StemTracker:
    """Bank of stem hypotheses; `observe` once a scan, `best` is what to believe.

    Args:
        prediction: the process with its disturbance at the input.
        valve: the valve model; may be replaced between scans.
        settings: uncertainties.
    """

    def __init__(
        self, prediction: Prediction, valve: ValveModel, settings: TrackerSettings
    ) -> None:
        self.prediction, self.valve, self.settings = prediction, valve, settings
        n = prediction.order
        noise = settings.noise
        enters = np.append(prediction.equation_gain, np.zeros(3))
        self._cross = noise.equation**2 * enters
        self._q = noise.equation**2 * np.outer(enters, enters)
        self._q[n, n] = (noise.disturbance / prediction.scale) ** 2
        self._r = noise.equation**2 + noise.measurement**2
        self._noise_power = self._held_noise_power()
        self.beliefs: list[Belief] = []
        self.variance = 0.0
        self._count = 0
        self._trend = 0.0
        self._reference = 0.0
        self._innovation = self._noise_now = self._r
        self._moved = np.zeros(n)  # the part of the process state that the stem's moves made
        self._doubt = 0.0
        self._gain = np.zeros(n + 3)
        self._covariance = np.zeros((n + 3, n + 3))
        # Until the noise is known the first PV values alone decide what the load is.
        self._covariance[n, n] = 100.0 * self._noise_power / prediction.scale**2

    def _held_noise_power(self) -> float:
        """Return PV's variance over that of the noise with the stem held; of an integrating
        process (it has no limit there) what comes up within 20 samples and the dead time.
        """
        p = self.prediction
        most = p.dead_time + 20 if p.process.is_integrating else 500
        state = self.prediction.equation_gain.copy()
        power = self._r
        for _ in range(most):
            power += self.settings.noise.equation**2 * float(state[0]) ** 2
            state = self.prediction.A @ state
        return power

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return bool(self.beliefs)

    @property
    def best(self) -> Belief:
        """The hypothesis that PV supports most."""
        return self.beliefs[0]

    @property
    def held_variance(self) -> float:
        """Variance of PV that the noise seen so far makes with the stem held (PV squared)."""
        return self.variance * self._noise_power

    @property
    def offset_variance(self) -> float:
        """Variance of the lasting PV offset that is still unknown (PV squared)."""
        n = self.prediction.order
        weights = self._regressor(self.best)
        unknown = float(weights @ self._covariance[n:, n:] @ weights)
        return unknown * self.variance * self.prediction.scale**2

    def drive(self, belief: Belief) -> float:
        """Return what drives the process while the stem rests where ``belief`` has it."""
        return belief.stem + float(self._regressor(belief) @ belief.errors)

    def free(self, belief: Belief) -> Array:
        """Return the state of the next scan if nothing drove the process (add ``B * drive``)."""
        p = self.prediction
        return np.asarray(p.A @ belief.state + p.equation_gain * belief.noise)

    def _regressor(self, belief: Belief) -> Array:
        return np.array([1.0, belief.direction, belief.stem - self._reference])

    def start(self, pv: float, op: float) -> None:
        """Assume rest at ``pv``; the stem may be anywhere inside the band around ``op``."""
        fs = self.valve.static_friction
        offsets = (0.0, -0.4, 0.4, -0.8, 0.8) if fs > 0.0 else (0.0,)
        state, drive = self.prediction.equilibrium(pv, 0.0)
        self._reference = op
        self.beliefs = [
            Belief(
                op + offset * fs,
                0.0,
                state.copy(),
                np.array([drive - op - offset * fs, 0.0, 0.0]),
                score=-0.5 * abs(offset),
            )
            for offset in offsets
        ]

    def observe(self, pv: float, op: float) -> None:
        """Take in PV of this scan (NaN: none) and the OP applied since the last one."""
        if not self.ready:
            if math.isfinite(pv):
                self.start(pv, op)
            return
        self._advance(op)
        self._correct(pv)

    def _advance(self, op: float) -> None:
        fs, fd = self.valve.static_friction, self.valve.dynamic_friction
        width = max(self.settings.spread * fs, 1e-12)
        moved: list[Belief] = []
        for h in self.beliefs:
            free = self.free(h)
            error = op - h.stem
            side = math.copysign(1.0, error)
            z = (abs(error) - fs) / width
            withstood = _tail(h.survived)
            stays = min(1.0, _tail(z) / withstood) if withstood > 0.0 else 1.0
            if z <= h.survived:
                stays = 1.0
            outcomes = []
            if stays > 0.006:
                tested = max(h.survived, z) if z > -4.0 else h.survived
                outcomes.append((h.stem, h.direction, math.log(stays), tested))
            if stays < 0.994:
                outcomes.append((op - side * fd, side, math.log(1.0 - stays), -math.inf))
            for stem, direction, log_chance, survived in outcomes:
                after = Belief(
                    stem, direction, free, h.errors.copy(), 0.0, h.score + log_chance, survived
                )
                after.state = free + self.prediction.B * self.drive(after)
                moved.append(after)
        self._spread_out()
        self.beliefs = self._likely(moved)
        p, before = self.prediction, float(self._moved[0])
        self._moved = p.A @ self._moved + p.B * (self.best.stem - self._reference)
        self._doubt = (self.settings.timing * (float(self._moved[0]) - before)) ** 2

    def _spread_out(self) -> None:
        """Carry the covariance over to the next scan, by Joseph's form (right for any gain)."""
        n = self.prediction.order
        A = np.eye(n + 3)
        A[:n, :n] = self.prediction.A
        A[:n, n:] = np.outer(self.prediction.B, self._regressor(self.best))
        gain = A @ self._gain
        if self._gain.any():
            gain = gain + self._cross / self._innovation
        F = A.copy()
        F[:, 0] -= gain
        mixed = np.outer(self._cross, gain)
        self._covariance = (
            F @ self._covariance @ F.T + self._q + self._noise_now * np.outer(gain, gain) - mixed - mixed.T
        )

    def _likely(self, beliefs: list[Belief]) -> list[Belief]:
        """Return the best few, best first: none hopeless, no more than two of one position."""
        ranked = sorted(beliefs, key=lambda h: -h.score)
        kept: list[Belief] = []
        for h in ranked:
            if h.score < ranked[0].score - 15.0 or len(kept) == self.settings.hypotheses:
                break
            if sum(other.stem == h.stem for other in kept) < 2:
                kept.append(h)
        return kept

    def _correct(self, pv: float) -> None:
        if not math.isfinite(pv):
            self._gain = np.zeros_like(self._gain)
            return
        n = self.prediction.order
        variance = max(self.variance, self._floor)
        self._noise_now = self._r + self._doubt / variance
        self._innovation = float(self._covariance[0, 0]) + self._noise_now
        self._gain = self._covariance[:, 0] / self._innovation
        keep = 1.0 - 1.0 / self.settings.memory
        carried = self.settings.noise.equation**2 / self._innovation
        surprises = {}
        for h in self.beliefs:
            surprise = pv - float(h.state[0])
            surprises[id(h)] = surprise
            h.state = h.state + self._gain[:n] * surprise
            h.errors = h.errors + self._gain[n:] * surprise
            h.noise = carried * surprise
            # Heavy tails: one wild sample must not decide between two positions.
            h.score = keep * h.score - 0.5 * min(surprise**2 / (self._innovation * variance), 25.0)
        self.beliefs = self._likely(self.beliefs)
        self._watch(surprises[id(self.best)])

    @property
    def _floor(self) -> float:
        """Variance below which a loop counts as free of noise."""
        return 1e-18 + (1e-6 * self.prediction.scale) ** 2

    def _watch(self, surprise: float) -> None:
        """Follow the noise's variance; learn afresh when innovations keep one sign too long."""
        n = self.prediction.order
        self._count += 1
        # Samples in which the model's own error may dominate say little about the noise.
        plain = self._innovation - self._noise_now + self._r
        square = surprise**2 / plain
        if self._count > 20:
            square = min(square, 16.0 * self.variance)
        share = plain / self._innovation
        self.variance += share * (square - self.variance) / min(self._count, 150)
        variance = max(self.variance, self._floor)
        rate = 0.05
        self._trend += rate * (surprise / math.sqrt(self._innovation * variance) - self._trend)
        if self._count == 20:  # the noise is known: what the uncertain parameters mean in it
            s, valve = self.settings, self.valve
            for index, deviation in (
                (LOAD, 0.5 * valve.static_friction),
                (FRICTION, s.spread * valve.dynamic_friction),
                (GAIN, s.gain_spread),
            ):
                self._covariance[n + index, n + index] += deviation**2 / variance
        elif abs(self._trend) > 4.0 * math.sqrt(rate / (2.0 - rate)):
            self._covariance[n, n] += 4.0 * self._noise_power / self.prediction.scale**2
            self._trend = 0.0
