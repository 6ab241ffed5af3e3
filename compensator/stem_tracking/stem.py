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

from compensator.kernels import coloured_power, next_state
from compensator.prediction import Prediction, settling_samples
from compensator.stem_tracking.belief import LOAD, Belief
from compensator.stem_tracking.fluctuation import RestFluctuation, held_correlations
from compensator.stem_tracking.hypotheses import RECALLED, Hypotheses
from compensator.stem_tracking.innovations import InnovationStatistics
from compensator.stem_tracking.load_steps import LoadStepDetector
from compensator.stem_tracking.resolution import PvResolution
from compensator.stem_tracking.shared_covariance import SharedCovariance
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
        self._hypotheses = Hypotheses(prediction, settings)
        self._resolution = PvResolution()
        self._noiseless = 1e-18 + (_NOISELESS * prediction.scale) ** 2
        self._first: list[tuple[float, float]] = []
        self._begin(InnovationStatistics(settings=settings.innovations))

    def _begin(self, innovations: InnovationStatistics) -> None:
        """Believe nothing yet but what is known of the noise."""
        prediction, settle = self.prediction, self._settle
        self._hypotheses.clear()
        self.innovations = innovations
        self._fluctuation = RestFluctuation(settle + prediction.dead_time, max(40, 2 * settle))
        self._rests: deque[tuple[float, float]] = deque(maxlen=RECALLED)
        self._load_steps = LoadStepDetector(prediction.dead_time)
        self.load_stepped = False
        self._unsettled = 0
        self._op = math.nan
        self._covariance.begin(self.valve)

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return len(self._hypotheses) > 0

    @property
    def is_unsettled(self) -> bool:
        """Whether what PV shows may be the answer to a step of the load that was seen."""
        return self._unsettled > 0

    @property
    def best(self) -> Belief:
        """The hypothesis that PV supports most."""
        return self._hypotheses.belief()

    @property
    def stem(self) -> float:
        """Position by the hypothesis that PV supports most."""
        return self._hypotheses.stem

    @property
    def stems(self) -> list[float]:
        """Positions by all hypotheses, the best one first."""
        return self._hypotheses.stems

    @property
    def chances(self) -> list[float]:
        """How likely each of `stems` is."""
        return self._hypotheses.chances

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
        return next_state(p.A, belief.state) + p.equation_gain * belief.noise

    def start(self, pv: float, op: float) -> None:
        """Assume rest at ``pv``; the stem may be anywhere inside the band around ``op``."""
        self._hypotheses.start(pv, op, self.valve)

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
        hypotheses = self._hypotheses
        if not len(hypotheses):
            if math.isfinite(pv):
                self.start(pv, op)
            return
        before = hypotheses.stem
        self._advance(op)
        self._correct(pv)
        if math.isfinite(pv):
            self._fluctuation.push(pv, moved=hypotheses.stem != before)

    def _advance(self, op: float) -> None:
        hypotheses = self._hypotheses
        spread = hypotheses.move(op, self.valve)
        way, turn = hypotheses.slip
        self._covariance.carry_over(way, turn, self.valve, self.innovations.colour)
        if spread is not None:
            self._covariance.add(spread)
        if way:
            self._covariance.doubt_response(way)
        self._op = op
        stem, rests = hypotheses.stem, self._rests
        if not rests or rests[-1][0] != stem:
            rests.append((stem, hypotheses.direction))

    def _recall(self) -> None:
        """Believe again in the last positions, if OP would not have moved the stem away."""
        deviation = self.settings.friction.static_deviation(self.valve)
        reach = self.valve.static_friction + 2.0 * deviation
        self._hypotheses.recall(self._rests, self._op, reach)

    def _correct(self, pv: float) -> None:
        if not math.isfinite(pv):
            self._covariance.skip()
            return
        floor = self._floor
        variance = max(self.innovations.variance, floor)
        # What the load makes of PV must not be learnt as an error of fD or of the gain.
        unsettled = self._unsettled > 0
        if unsettled:
            self._unsettled -= 1
        gain = self._covariance.gain(variance, self.innovations.colour, load_only=unsettled)
        innovation = self._covariance.innovation
        carried = variance * self.settings.noise.equation**2 / innovation
        farthest = self._farthest(innovation)
        surprise = self._hypotheses.correct(pv, innovation, farthest, gain, carried, self.valve)
        self._watch(surprise, floor)

    def _farthest(self, innovation: float, scans: int = 1) -> float:
        """Return the largest surprise that a process can be the reason of."""
        s = self.settings
        reach = scans * s.farthest_load * self.prediction.fastest
        return reach + s.farthest_noise * math.sqrt(innovation)

    @property
    def _floor(self) -> float:
        """Least variance of the noise: that of rounding, or what counts as free of noise."""
        return max(self._noiseless, self._resolution.variance)

    def _watch(self, surprise: float, floor: float) -> None:
        """Follow the noise, of at least ``floor``; learn afresh when innovations keep one sign too
        long.
        """
        seen, innovation = self.innovations, self._covariance.innovation
        seen.push(surprise, innovation, floor)
        if seen.is_learning:  # what was learnt before the noise was known is not worth much
            self._covariance.forget_errors(self.valve)
            self._hypotheses.forget_errors()
            seen.restart_trend()
        normal = surprise / math.sqrt(max(innovation, 1e-300))
        is_biased = seen.is_biased
        since = self._load_steps.push(normal, is_biased=is_biased)
        self.load_stepped = since > 0
        if since:
            size = self._load_steps.settings.size * max(self.valve.static_friction, 1e-3)
            self._covariance.expect_load(since, size)
            self._unsettled = self.prediction.dead_time + self._settle
        if is_biased:
            seen.restart_trend(colour=0.5)
            self._recall()
            self._covariance.doubt_load(4.0 * self.held_variance / self.prediction.scale**2)
