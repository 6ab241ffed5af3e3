"""From findings to a parameter block: what may be sent, and as what."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from fieldlink.daemon.estimation.estimating import Findings, Interval
from fieldlink.registers import Bounded, ParameterBlock, Status, Verdict

__all__ = ["Agreement", "Candidate", "findings_agree", "same_stick_band"]

SAME_STICK_BAND = 0.1
"""Stick bands of two windows that differ by this share of the larger one count as the same."""

_NONE = Bounded.exact(0.0)

STATUS_OF_VERDICT = {
    "stiction": Status.VALID,
    "no_stiction": Status.NO_STICTION,
    "not_assessable": Status.NOT_ASSESSABLE,
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """What may be written: findings, or an operator's withdrawal.

    Attributes:
        findings: what the estimator said.
        end_utc: end of the window, seconds since 1970.
        windows: windows in a row that agree with it, itself included.
        since: plant second of the window's end, from which its age counts.
        compensated: whether a block may have been in force during the window.
        withdrawal: the operator's reason; empty for findings.
        was_offered: whether the PLC has had it and has not taken it.
    """

    findings: Findings
    end_utc: float
    windows: int
    since: float = 0.0
    compensated: bool = False
    withdrawal: str = ""
    was_offered: bool = False

    @property
    def status(self) -> Status:
        """What the block asks of its reader."""
        if self.withdrawal:
            return Status.WITHDRAWN
        return STATUS_OF_VERDICT[self.findings.verdict]

    @classmethod
    def to_withdraw(cls, reason: str, end_utc: float) -> Candidate:
        """Return what withdraws the block that is there."""
        unknown = Interval(math.nan, math.nan, math.nan)
        nothing = Findings(
            verdict="not_assessable",
            reasons=(),
            score=0.0,
            stick_band=unknown,
            slip_jump=unknown,
            static_friction=unknown,
            dynamic_friction=unknown,
            confidence=0.9,
            r2=0.0,
            criterion="",
            samples=0,
            seconds=0.0,
            model=None,
            document={},
        )
        return cls(nothing, end_utc, 0, withdrawal=reason)

    def agrees_with(self, block: ParameterBlock) -> bool:
        """Whether a valid block says the same of the valve: see `same_stick_band`."""
        if self.status is not Status.VALID or block.status is not Status.VALID:
            return self.status is block.status
        return same_stick_band(_bounded(self.findings.stick_band), block.stick_band)

    def is_contradicted_by(self, findings: Findings) -> bool:
        """Whether newer findings say otherwise; a window that cannot tell says nothing."""
        if self.withdrawal or findings.verdict == "not_assessable":
            return False
        return not findings_agree(self.findings, findings)

    def says_less_than(self, other: Candidate) -> bool:
        """Whether this is of a window that cannot tell, and the other of one that can."""
        return self.status is Status.NOT_ASSESSABLE and other.status is not Status.NOT_ASSESSABLE

    def confirming(self, block: ParameterBlock) -> Candidate:
        """Return the same with the valve and the process of a block: it is confirmed as it is."""
        found = replace(
            self.findings,
            stick_band=_interval(block.stick_band),
            slip_jump=_interval(block.slip_jump),
            static_friction=_interval(block.static_friction),
            dynamic_friction=_interval(block.dynamic_friction),
            confidence=block.confidence,
            model=block.model,
        )
        return replace(self, findings=found)

    @classmethod
    def of_block(cls, block: ParameterBlock) -> Candidate:
        """Return what a block was made of, as far as the block tells."""
        findings = Findings(
            verdict=block.verdict.name.lower(),
            reasons=(),
            score=block.evidence,
            stick_band=_interval(block.stick_band),
            slip_jump=_interval(block.slip_jump),
            static_friction=_interval(block.static_friction),
            dynamic_friction=_interval(block.dynamic_friction),
            confidence=block.confidence,
            r2=block.fit,
            criterion="",
            samples=block.samples,
            seconds=0.0,
            model=None,
            document={},
        )
        end_utc = block.window_end_ms / 1000.0
        if block.status is Status.WITHDRAWN:
            return cls.to_withdraw("asked for before the daemon started again", end_utc)
        return cls(findings, end_utc, block.windows)

    def block(self, loop_id: int, seq: int, valid_for: int) -> ParameterBlock:
        """Return the block to send.

        Raises:
            BlockError: the findings cannot be expressed in a block.
        """
        found = self.findings
        sticky = self.status is Status.VALID
        model = found.model if sticky else None
        return ParameterBlock(
            loop_id=loop_id,
            seq=seq,
            status=self.status,
            valid_for=valid_for,
            window_end_ms=max(0, round(self.end_utc * 1000.0)),
            static_friction=_bounded(found.static_friction) if sticky else _NONE,
            dynamic_friction=_bounded(found.dynamic_friction) if sticky else _NONE,
            stick_band=_bounded(found.stick_band) if sticky else _NONE,
            slip_jump=_bounded(found.slip_jump) if sticky else _NONE,
            confidence=found.confidence,
            process=None if model is None else model.process,
            verdict=Verdict.NONE if self.withdrawal else Verdict.of(found.verdict),
            windows=min(self.windows, 0xFFFF),
            samples=found.samples,
            fit=_finite(found.r2),
            evidence=_finite(found.score),
        )


class Agreement:
    """Counts how many windows in a row say the same, and knows the surest of the latest.

    Windows agree when their verdict is the same and, for a sticky valve, their stick bands differ
    by at most a tenth or have overlapping intervals.

    Args:
        windows: how many of the latest are looked at for the surest: those that a block needs.
    """

    def __init__(self, windows: int = 1) -> None:
        self._latest: deque[Findings] = deque(maxlen=max(1, windows))
        self._count = 0

    def carry_over(self, other: Agreement) -> None:
        """Go on counting where another one was."""
        self._latest.extend(other._latest)
        self._count = other._count

    def count(self, findings: Findings) -> int:
        """Return the windows in a row that agree with ``findings``, this one included."""
        if not self._latest or not findings_agree(self._latest[-1], findings):
            self.start_again()
        self._latest.append(replace(findings, document={}))  # the document is large
        self._count += 1
        return self._count

    def start_again(self) -> None:
        """Count from the next window on: the experiment is another one."""
        self._latest.clear()
        self._count = 0

    def as_surest(self, newest: Findings) -> Findings:
        """Return the newest findings with valve and process of the surest window counted.

        That is the one with the narrowest interval of the stick band, for its size. A window with
        few strokes has a wide interval, agrees with nearly every other one, and knows less.
        """
        if newest.verdict != "stiction":
            return newest
        agreeing = [one for one in self._latest if findings_agree(one, newest)]
        known = [one for one in agreeing if one.model is not None and not one.uncertain]
        surest = min([newest, *reversed(known)], key=_relative_width)
        return replace(
            newest,
            stick_band=surest.stick_band,
            slip_jump=surest.slip_jump,
            static_friction=surest.static_friction,
            dynamic_friction=surest.dynamic_friction,
            confidence=surest.confidence,
            model=surest.model,
        )


def _relative_width(findings: Findings) -> float:
    """Width of the stick band's interval over the stick band; infinite where it is not known."""
    band = findings.stick_band
    width = (band.high - band.low) / band.value if band.value > 0.0 else math.inf
    return width if math.isfinite(width) else math.inf


def findings_agree(one: Findings, other: Findings) -> bool:
    """Whether two windows say the same: one verdict and, with stiction, one stick band."""
    if one.verdict != other.verdict:
        return False
    if one.verdict != "stiction":
        return True
    return same_stick_band(_bounded(one.stick_band), _bounded(other.stick_band))


def same_stick_band(a: Bounded, b: Bounded) -> bool:
    """Whether two stick bands differ by at most a tenth or have overlapping intervals."""
    close = abs(a.value - b.value) <= SAME_STICK_BAND * max(a.value, b.value)
    return close or (a.low <= b.high and b.low <= a.high)


def _bounded(interval: Interval) -> Bounded:
    """Bounds that are unknown or on the wrong side (rounding) become the value; none is below 0."""
    value = interval.value
    low = min(interval.low, value) if math.isfinite(interval.low) else value
    high = max(interval.high, value) if math.isfinite(interval.high) else value
    return Bounded(value, max(0.0, low), high)


def _interval(bounded: Bounded) -> Interval:
    return Interval(bounded.value, bounded.low, bounded.high)


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0
