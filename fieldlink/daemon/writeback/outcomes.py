"""The outcomes of a write-back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.registers import Bank, ParameterBlock
from fieldlink.store import WritebackRecord

__all__ = ["Attempt", "WritebackOutcome"]


class WritebackOutcome(Enum):
    """The outcome of an attempt, or why there was none; the code is stored, with advice."""

    BEGUN = ("begun", "about to be written; this row is stored first")
    COMMITTED = ("committed", "waiting for the PLC to acknowledge")
    ACCEPTED = ("accepted", "the PLC has accepted the block")
    REJECTED = ("rejected", "see the PLC's result code")
    NOT_ACKNOWLEDGED = ("not_acknowledged", "check that the PLC's block reader runs")
    READ_ONLY = ("read_only", "run without --read-only to write")
    TOO_FEW_WINDOWS = ("too_few_windows", "more windows have to agree: min_windows")
    OUT_OF_LIMITS = ("out_of_limits", "check the valve, or the limits in the site file")
    NOT_EXPRESSIBLE = ("not_expressible", "the findings do not fit a block")
    KEPT_VALID = (
        "kept_valid",
        "it replaces nothing: a loop under compensation cannot show a healthy valve, and a block "
        "in use expires by itself",
    )
    UNCERTAIN = ("uncertain", "the estimator doubts its figures; a better window decides")
    WRONG_PERIOD = (
        "wrong_period",
        "the model's time constants would be wrong; correct the loop's period in the site file, or "
        "name as scan a counter of the controller's cycles",
    )
    TOO_OLD = ("too_old", "newer windows have not confirmed it; see max_age")
    CONTRADICTED = ("contradicted", "a newer window contradicts it; it is not written")
    REFUSED_BEFORE = (
        "refused_before",
        "the PLC's controller refused this model; it is offered again when it differs, after "
        "valid_for, or when the operator clears and sets the enable bit",
    )
    HELD = (
        "held",
        "an operator has withdrawn the loop's block; clear the PLC's enable bit for four seconds "
        "and set it again to let blocks be written",
    )
    ON_HOLD = ("on_hold", "an operator holds new blocks; accept the model to end that")
    SWITCHED_OFF = (
        "switched_off",
        "an operator has switched the loop's write-back off; it is written when it is on again",
    )
    CONTRADICTS_BLOCK = (
        "contradicts_block",
        "a window under compensation never replaces the block in force; clear the enable bit for "
        "a window's length, or withdraw the block, to have the valve identified again",
    )
    CONTESTED = (
        "contested",
        "stop the other one, then clear the PLC's enable bit for four seconds and set it again",
    )
    DISAGREES = (
        "disagrees",
        "nothing is written until banks, commit and acknowledgement agree: look at the PLC's "
        "block reader, and for another client that writes to this area; a bank that one has "
        "spoilt is free again once all its registers are 0",
    )
    UNCHANGED = ("unchanged", "the PLC has a block that differs by less than the deadband")
    TOO_SOON = ("too_soon", "it is written when min_interval has passed")
    NOT_ENABLED = ("not_enabled", "it is written when the operator sets the PLC's enable bit")
    UNREACHABLE = ("unreachable", "it is written when the exchange area answers again")
    WRITE_FAILED = ("write_failed", "nothing was committed; it is tried again later")
    READBACK_DIFFERS = (
        "readback_differs",
        "nothing was committed; look for a second writer, and whether the registers keep all 16 "
        "bits of what is written, within a scan",
    )
    COMMIT_FAILED = ("commit_failed", "the PLC has the old or the new block; it is checked again")
    INTERRUPTED = (
        "interrupted",
        "the daemon ended before the commit; the active block is as it was",
    )
    NOT_RECORDED = ("not_recorded", "it is written when the store can be written again")
    SUPERSEDED = ("superseded", "a newer estimate took its place before it was written")

    def __init__(self, code: str, advice: str) -> None:
        self.code = code
        self.advice = advice

    @classmethod
    def of(cls, code: str) -> WritebackOutcome:
        """Return the outcome with a code, as it is stored."""
        return cls[code.upper()]

    @property
    def leaves_open(self) -> bool:
        """Whether a row with this outcome, if it is the last of a block, is not the whole story."""
        return self in _LEAVES_OPEN

    @property
    def leaves_withdrawal_open(self) -> bool:
        """The same for a withdrawal, which the PLC must get: its commit may be gone."""
        return self.leaves_open or self is WritebackOutcome.NOT_ACKNOWLEDGED

    @property
    def leaves_pending(self) -> bool:
        """Whether the candidate waits for another attempt."""
        return self in _LEAVES_PENDING


_LEAVES_OPEN = frozenset(
    {WritebackOutcome.BEGUN, WritebackOutcome.COMMITTED, WritebackOutcome.COMMIT_FAILED}
)

_LEAVES_PENDING = frozenset(
    {
        WritebackOutcome.NOT_RECORDED,
        WritebackOutcome.TOO_SOON,
        WritebackOutcome.NOT_ENABLED,
        WritebackOutcome.UNREACHABLE,
        WritebackOutcome.WRITE_FAILED,
        WritebackOutcome.READBACK_DIFFERS,
        WritebackOutcome.COMMIT_FAILED,
        WritebackOutcome.CONTESTED,
        WritebackOutcome.DISAGREES,
        WritebackOutcome.ON_HOLD,
        WritebackOutcome.SWITCHED_OFF,
    }
)


@dataclass(frozen=True, slots=True)
class Attempt:
    """An outcome with all that belongs to it.

    Attributes:
        outcome: how it ended.
        reason: the figures behind it, in words.
        candidate: what was to be written.
        block, words, bank: what was written and where; None when it did not come to that.
        bank_before, active_before: the banks' registers before.
    """

    outcome: WritebackOutcome
    reason: str
    candidate: Candidate
    block: ParameterBlock | None = None
    words: tuple[int, ...] | None = None
    bank: Bank | None = None
    bank_before: tuple[int, ...] | None = None
    active_before: tuple[int, ...] | None = None

    @property
    def why(self) -> str:
        """The figures behind the outcome, and what it means."""
        return "; ".join(word for word in (self.reason, self.outcome.advice) if word)

    def became(self, outcome: WritebackOutcome, reason: str) -> Attempt:
        """Return the same attempt with another outcome."""
        return replace(self, outcome=outcome, reason=reason)

    def record(self, loop: str, utc: float) -> WritebackRecord:
        """Return what to store; ``utc`` in seconds since 1970."""
        found, why = self.candidate.findings, self.why
        if self.candidate.withdrawal:
            why = f"withdrawn by an operator: {self.candidate.withdrawal}; {why}"
        return WritebackRecord(
            loop=loop,
            utc_ms=round(utc * 1000.0),
            outcome=self.outcome.code,
            reason=why,
            seq=None if self.block is None else self.block.seq,
            bank=None if self.bank is None else self.bank.name,
            status=self.candidate.status.name.lower(),
            stick_band=found.stick_band.value,
            slip_jump=found.slip_jump.value,
            words=self.words,
            bank_before=self.bank_before,
            active_before=self.active_before,
        )
