"""Everything that was found about a loop, before it is weighed into causes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.controller.controller import Controller
from estimator.diagnosis.curvature import Curvature
from estimator.diagnosis.explanations import Explained
from estimator.diagnosis.facts import Limits, Sensor
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.outcomes import Reason, ReasonCode

__all__ = ["Gathered", "error_lasts"]

_STEEPEST = math.exp(5.0)
"""Largest factor on a gain: beyond, any loop swings."""


def error_lasts(predictable: tuple[float, float], settings: DiagnosisSettings) -> bool:
    """Whether the shares told one and two integral times ahead are those of a slow tuning.

    Two integral times may be too long for the record: that share is then NaN.
    """
    one, two = np.nan_to_num(predictable)
    return bool(two > settings.judging.slow or one + two > settings.judging.lingering)


def _unknown() -> float:
    """NaN: nothing was asked."""
    return math.nan


@dataclass(frozen=True)
class Gathered:
    """Everything that was found about a loop.

    Attributes:
        swing, signal: the main oscillation and where it is.
        limits, sensor, manual: facts of the record; ``manual`` is a share of the samples.
        has_mode: whether the controller's mode was recorded.
        still: share of the samples in which OP stands still for long, and nothing tells whether a
            hand holds it: no controller explains OP's moves, and no mode was recorded.
        has_pv: whether PV was recorded.
        controller, explained, loop: what was identified; None where it could not be.
        loop_beside_wave: the loop with the process as fitted beside a wave from outside; None
            where no wave was tried.
        gap: error up to which OP stands still, NaN where it does not depend on the error.
        curvature: how the gain changes over the record; None for a gain that does not.
        op_span: span of OP.
        predictable: shares of the error told one and two integral times ahead.
        setpoint_swings: whether SP has the oscillation too.
        wave_share: share of the error's variance around the period of the wave that comes with a
            sticky valve.
        swing_share: share of the error's variance around the period of the main oscillation.
        amplitude: deviation of the main oscillation's amplitude over its mean, NaN without one;
            in_phase: share of its squared amplitude that keeps one phase; unlike_noise: evidence
            (nats) that its size and phase change as those of no swing that noise keeps going.
        open_swing, open_share: the oscillation of the longest time in which OP stands still, in
            manual or at a limit, and its share of the error's variance; None without one.
        removable: share of the squared error that robust settings would remove, by the identified
            process; NaN where no such settings can be found.
        ask_headroom: finds `headroom`, which costs more than most of the others.
        ask_own_wave: finds `own_wave`.
        samples: of the window that was explained.
        duration_s: of the whole record.
    """

    swing: Oscillation
    signal: str
    limits: Limits
    has_pv: bool
    sensor: Sensor | None = None
    manual: float = 0.0
    has_mode: bool = True
    still: float = 0.0
    controller: Controller | None = None
    explained: Explained | None = None
    loop: LinearLoop | None = None
    loop_beside_wave: LinearLoop | None = None
    gap: float = math.nan
    curvature: Curvature | None = None
    op_span: float = 0.0
    predictable: tuple[float, float] = (math.nan, math.nan)
    setpoint_swings: bool = False
    wave_share: float = 0.0
    swing_share: float = 0.0
    amplitude: float = math.nan
    in_phase: float = math.nan
    unlike_noise: float = 0.0
    open_swing: Oscillation | None = None
    open_share: float = 0.0
    removable: float = math.nan
    ask_headroom: Callable[[], float] = _unknown
    ask_own_wave: Callable[[], float] = _unknown
    samples: int = 0
    duration_s: float = math.inf

    def removable_where_known(self, settings: DiagnosisSettings) -> float:
        """What robust settings would remove, NaN where the process hardly shows."""
        one = self.explained
        known = one is not None and one.process >= settings.judging.threshold
        return self.removable if known else math.nan

    @cached_property
    def headroom(self) -> float:
        """Probability that robust settings have far more integral gain, over processes and loads.

        NaN where it cannot be told.
        """
        return self.ask_headroom()

    @cached_property
    def own_wave(self) -> float:
        """Evidence (nats) for a wave from outside at the period of the loop's own swing, or NaN."""
        return self.ask_own_wave()

    def amplification(self) -> tuple[float, float]:
        """How the loop amplifies a disturbance at the oscillation's period, and Ms."""
        return self._amplification

    @cached_property
    def _amplification(self) -> tuple[float, float]:
        if self.loop is None:
            return math.nan, math.nan
        margins = self.loop.margins()
        if not self.swing.present:
            return math.nan, margins.sensitivity
        return self._at_period(self.loop), margins.sensitivity

    def amplification_beside_wave(self) -> float:
        """The same at the oscillation's period by what the record shows away from it, or NaN.

        A loop that swings by itself has its resonance there too; one that is swung has it not.
        """
        if self.loop_beside_wave is None or not self.swing.present:
            return math.nan
        return self._at_period(self.loop_beside_wave)

    def amplification_at_steepest(self) -> float:
        """The same where the gain is largest within the middle nine tenths of OP or PV, or NaN."""
        if self.loop is None or self.explained is None or not self.swing.present:
            return math.nan
        curvature = self.curvature
        steeper = 1.0 if curvature is None else min(_STEEPEST, curvature.steepest)
        loop = replace(self.loop, b=self.loop.b * steeper)
        return self._at_period(loop) if loop.margins().stable else math.inf

    def _at_period(self, loop: LinearLoop) -> float:
        # the identified resonance and the measured period agree to some per cent
        f = loop.period / self.swing.period_s * np.geomspace(0.9, 1.1, 9)
        return float(np.max(np.abs(loop.sensitivity(f[f < 0.5])), initial=0.0))

    @property
    def has_gap(self) -> bool:
        """Whether the controller leaves small errors as they are."""
        return math.isfinite(self.gap)

    @property
    def drawn(self) -> Reason | None:
        """Why the record tells nothing faster than its knots: a historian drew lines between."""
        reasons = () if self.explained is None else self.explained.reasons
        of_lines = (one for one in reasons if one.code is ReasonCode.RECORD_INTERPOLATED)
        return next(of_lines, None)

    @property
    def is_sticky(self) -> bool:
        """Whether a sticky valve explains the record."""
        return self.explained is not None and self.explained.sticks

    def is_read(self, settings: DiagnosisSettings) -> bool:
        """Whether the controller is known well enough to close the loop with."""
        one = self.controller
        return one is not None and (one.timed or one.explained >= settings.judging.explains)

    def doubts_valve(self, settings: DiagnosisSettings) -> bool:
        """Whether a wave from outside that swings unevenly may stand for the sticky valve."""
        one = self.explained
        return one is not None and one.sticks and one.over_waves < settings.judging.threshold
