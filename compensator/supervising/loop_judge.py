"""The compensated loop, scan by scan, as its watch and its record see it.

`LoopWatch` compares figures. What it needs of a scan is put together here: which changes of the
set-point and which steps of the load are not the compensator's doing, and whether PV answers to OP
the way the model has it.
"""

from __future__ import annotations

import math
from dataclasses import replace

from compensator.supervising.figures import LoopFigures, LoopRecord
from compensator.supervising.load_cause import explained_by_load
from compensator.supervising.record_check import seen_agreement
from compensator.supervising.supervision import Compensator, SupervisorSettings
from compensator.supervising.watch import LoopWatch, Watched, WatchVerdict

__all__ = ["LoopJudge"]


class LoopJudge:
    """Judges a compensated loop; `begin` at each take-over, then `push` once a scan.

    Args:
        settings: of the supervisor.
        record: the latest scans of the loop.

    Attributes:
        limited: whether the compensator could not reach the set-point in the last scan.
    """

    def __init__(self, settings: SupervisorSettings, record: LoopRecord) -> None:
        self._settings, self._record = settings, record
        self._watch: LoopWatch | None = None
        self._sp = math.nan
        self._slope = 0.0
        self._own_scans = 0
        self._outside = 0
        self._load_stepped = math.inf
        self.limited = False

    def follow(self, sp: float) -> None:
        """Take in the set-point of a scan in which the compensator does not have the loop."""
        self._slope = sp - self._sp if math.isfinite(self._sp) else 0.0
        self._sp = sp

    def forget(self) -> None:
        """Drop what was seen: another model will have the loop."""
        self._watch = None

    def begin(self, before: LoopFigures, candidate: Compensator) -> None:
        """Begin to judge ``candidate``, against the figures of before."""
        if self._watch is None or self._watch.before != before:
            self._watch = LoopWatch(
                before,
                self._settings.watch,
                horizon=candidate.horizon,
                dead_time=candidate.prediction.dead_time,
                stroke=candidate.model.valve.stick_band,
                step=_step_of(candidate, before),
            )
        self._watch.restart(candidate.horizon // 2)
        self._own_scans = self._outside = 0
        self._load_stepped = math.inf
        self.limited = False

    @property
    def on_trial(self) -> bool:
        """Whether the compensator has not been judged yet."""
        watch = self._watch
        return watch is not None and not watch.judged and self._own_scans < watch.longest_trial

    def push(
        self,
        compensator: Compensator,
        pv: float,
        sp: float,
        op: float,
        moved: float,
        stem: float = math.nan,
    ) -> WatchVerdict:
        """Return what is to be said of this scan.

        Args:
            compensator: what has the loop.
            pv: measured, NaN when bad.
            sp: set-point.
            op: applied since the last scan.
            moved: way of the stem, by the valve model.
            stem: where it is, by that model; NaN if not known.
        """
        assert self._watch is not None
        change, self._sp = sp - self._sp, sp
        asked = abs(change) / compensator.prediction.scale
        process = compensator.prediction.process
        if process.is_integrating:  # a ramp asks for another slope once, where it begins or turns
            asked = min(asked, abs(change - self._slope) / abs(math.fsum(process.b)))
        self._slope = change
        # A set-point that moves by little each scan is to be followed inside the known range.
        if abs(change) > self._settings.watch.stepped * self._watch.before.largest:
            self._watch.restart(compensator.horizon // 2)
        elif compensator.load_stepped:
            self._watch.excuse(compensator.horizon // 2)
        self._load_stepped = 0.0 if compensator.load_stepped else self._load_stepped + 1.0
        if not math.isfinite(pv):
            return WatchVerdict.FINE
        inside = abs(pv - sp) <= self._watch.before.largest
        self._outside = 0 if inside else self._outside + 1
        limits = self._settings.hybrid.limits
        reach = 1e-6 * (limits.high - limits.low)
        seen = Watched(
            error=pv - sp,
            travel=moved,
            noise_variance=compensator.held_variance,
            sp_travel=asked,
            sp_change=change,
            limited=self.limited,
            at_limit=op <= limits.low + reach or op >= limits.high - reach,
            stem=stem,
        )
        verdict = self._watch.push(seen)
        self._own_scans += 1
        if compensator.opposed:
            return WatchVerdict.WRONG_SIGN
        if verdict is WatchVerdict.FINE and self._answers_wrongly(compensator, seen):
            return WatchVerdict.LEFT_RANGE
        return verdict

    def load_did_it(self, compensator: Compensator) -> bool:
        """Whether PV left its range because a step of the load drove it out."""
        run = compensator.prediction.dead_time + self._settings.watch.trip_scans
        since = self._outside + run
        if self._load_stepped > since:
            return False
        samples = self._record.latest(since + compensator.horizon)
        return explained_by_load(
            samples,
            min(since, len(samples)),
            compensator.prediction,
            compensator.model.valve,
            self._settings.watch.unexplained,
        )

    def _answers_wrongly(self, compensator: Compensator, seen: Watched) -> bool:
        """Whether PV is farther off than ever and has moved against what the model makes of OP.

        The record from before a take-over may be silent on the sign, as that of a valve at rest is;
        a long dead time then lets PV go slowly, and its range would be left late.
        """
        assert self._watch is not None
        check = self._settings.check
        far = abs(seen.error) > check.farther * self._watch.before.largest
        if not far or seen.limited or self._own_scans % check.every:
            return False
        since = self._record.latest(min(self._own_scans, self._settings.history))
        agrees = seen_agreement(
            compensator.model,
            [s.op for s in since],
            [s.pv for s in since],
            replace(check, shortest=check.own_shortest),
        )
        return agrees < 0


def _step_of(compensator: Compensator, before: LoopFigures) -> float:
    """Return what a slip jump makes of PV before the next one: in half a period of the loop before.

    A slow process, as a level often is taken for, has made little of its gain by then. Of a level
    it is what has been made when PV first shows it. Where the stem moved before, what its slips
    make is in the range that is known: a model that says more has too large a gain.
    """
    jump, prediction = compensator.model.valve.slip_jump, compensator.prediction
    scans = 1 if prediction.process.is_integrating else math.ceil(0.5 * before.period)
    step = float(jump * abs(prediction.step_response(prediction.dead_time + scans)).max())
    moved = before.travel * before.period >= jump
    return min(step, before.largest) if moved else step
