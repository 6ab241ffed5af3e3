"""The newest candidate that waits for its turn; why it waits is reported once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.rules import Objection

__all__ = ["Waiting"]

_FAILURES = (
    WritebackOutcome.WRITE_FAILED,
    WritebackOutcome.READBACK_DIFFERS,
    WritebackOutcome.COMMIT_FAILED,
    WritebackOutcome.UNREACHABLE,
)


class Waiting:
    """Holds at most one candidate.

    Args:
        report: called with every attempt and every decision.

    Attributes:
        candidate: what waits; None when nothing does.
    """

    def __init__(self, report: Callable[[Attempt], None]) -> None:
        self._report = report
        self._reported: WritebackOutcome | None = None
        self._failure = ""
        self.candidate: Candidate | None = None

    @property
    def is_withdrawal(self) -> bool:
        """Whether an operator's withdrawal waits."""
        return self.candidate is not None and bool(self.candidate.withdrawal)

    def forget_withdrawal(self) -> bool:
        """End the wait of a withdrawal that the PLC has not taken; return whether one waits still.

        One that the PLC has not had yet may wait for the very enable bit that an operator sets.
        """
        if self.is_withdrawal and self.candidate is not None and self.candidate.was_offered:
            self.candidate = None
        return self.is_withdrawal

    @property
    def words(self) -> str | None:
        """What waits and why; None when nothing does."""
        if self.candidate is None:
            return None
        what = self.candidate.status.name.lower().replace("_", " ")
        if self._reported is None:
            return f"{what}: its turn comes with the next look"
        return "; ".join(
            word for word in (f"{what}: {self._reported.advice}", self._before) if word
        )

    @property
    def _before(self) -> str:
        return f"the attempt before: {self._failure}" if self._failure else ""

    def note_end(self, attempt: Attempt) -> None:
        """Remember why the newest attempt failed: it is why blocks wait, whatever they wait for.

        It is forgotten when one is committed.
        """
        if attempt.outcome in _FAILURES:
            self._failure = f"{attempt.outcome.code}, {attempt.reason}"
        elif attempt.outcome is WritebackOutcome.COMMITTED:
            self._failure = ""

    def carry_over(self, other: Waiting) -> None:
        """Go on where another one was."""
        self.put(other.candidate)
        self._failure = other._failure

    def put(self, candidate: Candidate | None, reported: WritebackOutcome | None = None) -> None:
        """Let a candidate wait in place of what waited; ``reported`` is why, if that is known."""
        self.candidate, self._reported = candidate, reported

    def supersede(self, candidate: Candidate) -> None:
        """Replace the waiting candidate by a newer one, and record it."""
        if self.candidate is not None:
            self._report(Attempt(WritebackOutcome.SUPERSEDED, "", self.candidate))
        self.put(candidate)

    def clear(self, candidate: Candidate) -> None:
        """End the wait of a candidate if it is that which waits."""
        if self.candidate is candidate:
            self.candidate = None

    def mark_compensated(self) -> None:
        """Note that a block may have been in force during the window of what waits."""
        if self.candidate is not None and not self.is_withdrawal:
            self.candidate = replace(self.candidate, compensated=True)

    def explain(self, outcome: WritebackOutcome, reason: str) -> None:
        """Report why what waits has to wait; once for each reason in a row."""
        if self.candidate is not None:
            self.explain_attempt(Attempt(outcome, reason, self.candidate))

    def explain_attempt(self, attempt: Attempt) -> None:
        """Report why an attempt has to wait; once for each reason in a row."""
        if self._reported is not attempt.outcome:
            self._reported = attempt.outcome
            known = "" if attempt.outcome in _FAILURES else self._before
            reason = "; ".join(word for word in (attempt.reason, known) if word)
            self._report(attempt.became(attempt.outcome, reason))

    def heed(self, objection: Objection, candidate: Candidate) -> None:
        """Let a candidate wait, or give it up, as an objection asks."""
        if objection.outcome.leaves_pending:
            self.explain(objection.outcome, objection.reason)
            return
        self.clear(candidate)
        self._report(Attempt(objection.outcome, objection.reason, candidate))
