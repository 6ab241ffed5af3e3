"""Where the stem stands: a few hypotheses, each with its own filter, judged by PV.

Between slips the stem is not visible, and whether a command near the static friction made it slip
depends on parameters that are known to some per cent only. So every such command leaves two
hypotheses, *it slipped* and *it stayed*. Each carries the process state that it implies; the
innovations of PV tell them apart within a few samples, and the better one is believed from then on
(a missed or an unexpected slip is re-synchronised that way). A certain slip makes all of them
agree: after it the position is ``OP -/+ fD``, whatever it was before. Hypotheses that agree are
merged by their moments, so that the spread of their loads stays in the covariance. The friction
that a slip needs has a prior (`FrictionPrior`) that is never forgotten; a hypothesis that has
survived a command knows that it needs more than that command.

What is wrong in the parameters is learnt with the state, as three more unknowns of the filter.
What drives the process is ``x + m``, with ``m`` the load (the offset-free disturbance). A slip of
the stem by ``s`` changes ``m`` by ``w t + g s``: ``w`` is the error of fD, which counts where the
direction turns by ``t`` (without it a wrong fD makes the loop hunt between two positions), ``g``
the relative error of the process gain. At rest they cannot be seen and stay what they are
(`SharedCovariance`).
"""

from __future__ import annotations

import itertools
import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import coloured_power, multiplied
from compensator.prediction import Prediction, settling_samples
from compensator.stem_tracking.belief import FRICTION, GAIN, LOAD, Belief, chances_of, merge_alike
from compensator.stem_tracking.fluctuation import RestFluctuation, held_correlations
from compensator.stem_tracking.innovations import InnovationStatistics
from compensator.stem_tracking.load_steps import LoadStepDetector
from compensator.stem_tracking.resolution import PvResolution
from compensator.stem_tracking.shared_covariance import SharedCovariance
from compensator.stem_tracking.stem_hypotheses import (
    first_beliefs,
    likely_ones,
    outcomes_of,
    recalled_ones,
)
from compensator.stem_tracking.tracker_settings import TrackerSettings
from loop_model import ValveModel

__all__ = ["Belief", "StemTracker"]

Array = NDArray[np.float64]

_NOISELESS = 1e-5
"""Deviation of PV, per OP's effect, that counts as free of noise: its square and that of a load of
a hundred OP are still apart by less than double precision resolves.
"""


class StemTracker:
    """Bank of stem hypotheses; `observe` once a scan, `best` is what to believe.

    Args:
        prediction: the process with its disturbance at the input.
        valve: the valve model; may be replaced between scans.
        settings: uncertainties.

    Attributes:
        load_stepped: whether the last PV showed a step of the load.
    """

    def __init__(
        self, prediction: Prediction, valve: ValveModel, settings: TrackerSettings
    ) -> None:
        self.prediction, self.valve, self.settings = prediction, valve, settings
        settle = settling_samples(prediction)
        self._covariance = SharedCovariance(prediction, settings, settle)
        self._correlations = held_correlations(prediction)
        self._settle = settle
        self._resolution = PvResolution()
        self._first: list[tuple[float, float]] = []
        self._begin(InnovationStatistics(settings=settings.innovations))

    def _begin(self, innovations: InnovationStatistics) -> None:
        """Believe nothing yet but what is known of the noise."""
        prediction, settle = self.prediction, self._settle
        self.beliefs: list[Belief] = []
        self.innovations = innovations
        self._fluctuation = RestFluctuation(settle + prediction.dead_time, max(40, 2 * settle))
        self._rests: deque[tuple[float, float]] = deque(maxlen=4)
        self._load_steps = LoadStepDetector(prediction.dead_time)
        self.load_stepped = False
        self._unsettled = 0
        self._op = math.nan
        self._covariance.begin(self.valve)

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return bool(self.beliefs)

    @property
    def best(self) -> Belief:
        """The hypothesis that PV supports most."""
        return self.beliefs[0]

    @property
    def chances(self) -> list[float]:
        """How likely each of `beliefs` is."""
        return chances_of(self.beliefs)

    @property
    def held_variance(self) -> float:
        """Variance of PV that the noise seen so far makes with the stem held (PV squared)."""
        noise, lags = self.settings.noise, self._correlations
        seen = self.innovations
        power = noise.equation**2 * coloured_power(lags, seen.correlation) + noise.measurement**2
        bound = self.settings.fluctuation_margin * self._fluctuation.variance
        return min(seen.variance * max(power, 0.0), max(bound, self._floor))

    @property
    def carried_variance(self) -> float:
        """The part of `held_variance` that passes through the process: the state holds it too.

        0 where the noise is the measurement's: what its model lets pass allows for model errors.
        """
        noise = self.settings.noise
        if noise.equation < noise.measurement:
            return 0.0
        return max(0.0, self.held_variance - self.innovations.variance * noise.measurement**2)

    @property
    def offset_variance(self) -> float:
        """Variance of the lasting PV offset that is still unknown (PV squared)."""
        return self._covariance.load_variance * self.prediction.scale**2

    def drive(self, belief: Belief) -> float:
        """Return what drives the process while the stem rests where ``belief`` has it."""
        return belief.stem + float(belief.errors[LOAD])

    def free(self, belief: Belief) -> Array:
        """Return the state of the next scan if nothing drove the process (add ``B * drive``)."""
        p = self.prediction
        return multiplied(p.A, belief.state) + p.equation_gain * belief.noise

    def start(self, pv: float, op: float) -> None:
        """Assume rest at ``pv``; the stem may be anywhere inside the band around ``op``."""
        self.beliefs = first_beliefs(self.prediction, pv, op, self.valve, self.settings)

    def observe(self, pv: float, op: float) -> None:
        """Take in PV of this scan (NaN: none) and the OP applied since the last one."""
        self._resolution.push(pv)
        self._take_in(pv, op)
        first = self.settings.innovations.first
        if len(self._first) < first and math.isfinite(pv):
            self._first.append((pv, op))
            if len(self._first) == first:
                self._relive()

    def _relive(self) -> None:
        """Go through the first scans again, now that the size of the noise can be told.

        Without it the first PVs count as free of noise, and what is noise in them is taken for the
        state and the load.
        """
        squares = sorted((b[0] - a[0]) ** 2 for a, b in itertools.pairwise(self._first))
        # Half the mean square of a normal change, by its median (0.455 of it): robust to a slip.
        variance = 0.5 * squares[len(squares) // 2] / 0.455
        settings = self.settings.innovations
        self._begin(InnovationStatistics(variance, settings.first, settings))
        # What lies apart from all others would be the rest that everything starts from.
        middle = sorted(pv for pv, _ in self._first)[len(self._first) // 2]
        apart = self._farthest(variance, len(self._first))
        for pv, op in self._first:
            self._take_in(pv if abs(pv - middle) <= apart else math.nan, op)

    def _take_in(self, pv: float, op: float) -> None:
        self.innovations.evidence = 0.0
        if not self.ready:
            if math.isfinite(pv):
                self.start(pv, op)
            return
        before = self.best.stem
        self._advance(op)
        self._correct(pv)
        if math.isfinite(pv):
            self._fluctuation.push(pv, moved=self.best.stem != before)

    def _advance(self, op: float) -> None:
        moved: list[Belief] = []
        for h in self.beliefs:
            free = self.free(h)
            outcomes = outcomes_of(h, op, self.valve, self.settings)
            for after in outcomes:
                after.state = free + self.prediction.B * self.drive(after)
            moved += outcomes
        merged, spreads = merge_alike(moved)
        self.beliefs = likely_ones(merged, self.settings)
        self._covariance.carry_over(self.best, self.valve, self.innovations.colour)
        if self.best.stem in spreads:
            self._covariance.add(spreads[self.best.stem])
        if self.best.way:
            self._covariance.doubt_response(self.best.way)
        self._op = op
        here = (self.best.stem, self.best.direction)
        if not self._rests or self._rests[-1][0] != here[0]:
            self._rests.append(here)

    def _recall(self) -> None:
        """Believe again in the last positions, if OP would not have moved the stem away."""
        s = self.settings
        reach = self.valve.static_friction + 2.0 * s.friction.static_deviation(self.valve)
        earlier = recalled_ones(self.best, self._rests, self._op, reach, s.recalled)
        self.beliefs = likely_ones(self.beliefs + earlier, s)

    def _correct(self, pv: float) -> None:
        if not math.isfinite(pv):
            self._covariance.skip()
            return
        n, settings = self.prediction.order, self.settings
        variance = max(self.innovations.variance, self._floor)
        # What the load makes of PV must not be learnt as an error of fD or of the gain.
        unsettled = self._unsettled > 0
        self._unsettled = max(0, self._unsettled - 1)
        gain = self._covariance.gain(variance, self.innovations.colour, load_only=unsettled)
        innovation = self._covariance.innovation
        carried = variance * settings.noise.equation**2 / innovation
        farthest = self._farthest(innovation)
        surprises = {
            id(h): min(max(pv - float(h.state[0]), -farthest), farthest) for h in self.beliefs
        }
        # Heavy tails: one wild sample must not decide between two positions.
        evidence = {h: -0.5 * min(value**2 / innovation, 9.0) for h, value in surprises.items()}
        # A PV that all hypotheses expected alike tells nothing, and lets nothing be forgotten:
        # otherwise all of them are likely again after a long rest.
        most = max(evidence.values())
        keep = 1.0 - (1.0 - math.exp(min(evidence.values()) - most)) / settings.memory
        of_state, of_errors = gain[:n], gain[n:]
        for h in self.beliefs:
            surprise = surprises[id(h)]
            h.state = h.state + of_state * surprise
            h.errors = h.errors + of_errors * surprise
            h.noise = carried * surprise
            self._keep_believable(h)
            h.see(evidence[id(h)] - most, keep)
        self.beliefs = likely_ones(self.beliefs, settings)
        self._watch(surprises[id(self.best)])

    def _farthest(self, innovation: float, scans: int = 1) -> float:
        """Return the largest surprise that a process can be the reason of."""
        s = self.settings
        reach = scans * s.farthest_load * self.prediction.fastest
        return reach + s.farthest_noise * math.sqrt(innovation)

    @property
    def _floor(self) -> float:
        """Least variance of the noise: that of rounding, or what counts as free of noise."""
        return max(1e-18 + (_NOISELESS * self.prediction.scale) ** 2, self._resolution.variance)

    def _watch(self, surprise: float) -> None:
        """Follow the noise; learn afresh when innovations keep one sign too long."""
        seen, innovation = self.innovations, self._covariance.innovation
        seen.push(surprise, innovation, self._floor)
        if seen.is_learning:  # what was learnt before the noise was known is not worth much
            self._covariance.forget_errors(self.valve)
            for h in self.beliefs:
                h.errors[FRICTION], h.errors[GAIN] = 0.0, self.settings.gain - 1.0
            seen.restart_trend()
        normal = surprise / math.sqrt(max(innovation, 1e-300))
        since = self._load_steps.push(normal, is_biased=seen.is_biased)
        self.load_stepped = since > 0
        if since:
            size = self._load_steps.settings.size * max(self.valve.static_friction, 1e-3)
            self._covariance.expect_load(since, size)
            self._unsettled = self.prediction.dead_time + self._settle
        if seen.is_biased:
            seen.restart_trend(colour=0.5)
            self._recall()
            self._covariance.doubt_load(4.0 * self.held_variance / self.prediction.scale**2)

    def _keep_believable(self, h: Belief) -> None:
        """Limit the errors of fD and of the gain to plausible values: half of what is expected."""
        gain = self.settings.gain
        fd = 0.5 * gain * self.valve.dynamic_friction
        low, high = 0.5 * gain - 1.0, 1.5 * gain - 1.0
        _, wrong, error = h.errors.tolist()
        if not -fd <= wrong <= fd:
            h.errors[FRICTION] = min(max(wrong, -fd), fd)
        if not low <= error <= high:
            h.errors[GAIN] = min(max(error, low), high)
