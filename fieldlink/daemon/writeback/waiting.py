"""The newest candidate that waits for its turn; why it waits is reported once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.rules import Objection

__all__ = ["Waiting"]


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
        return f"{what}: {self._reported.advice}"

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
            self._report(attempt)

    def heed(self, objection: Objection, candidate: Candidate) -> None:
        """Let a candidate wait, or give it up, as an objection asks."""
        if objection.outcome.leaves_pending:
            self.explain(objection.outcome, objection.reason)
            return
        self.clear(candidate)
        self._report(Attempt(objection.outcome, objection.reason, candidate))
