"""New findings on their way to the queue of one: counted, compared with what waits, judged."""

from __future__ import annotations

from collections.abc import Callable

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.candidate import Agreement, Candidate
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.permission import WritePermission
from fieldlink.daemon.writeback.waiting import Waiting

__all__ = ["Intake"]


class Intake:
    """Takes findings in.

    Args:
        permission: judges what may wait.
        waiting: holds what waits.
        report: called with every decision.
        windows: that have to agree before a block is written.
    """

    def __init__(
        self,
        permission: WritePermission,
        waiting: Waiting,
        report: Callable[[Attempt], None],
        windows: int,
    ) -> None:
        self._permission = permission
        self._waiting = waiting
        self._report = report
        self._agreement = Agreement(windows)
        self._found_at: float | None = None

    def carry_over(self, other: Intake) -> None:
        """Go on counting where another one was."""
        self._agreement.carry_over(other._agreement)
        self._found_at = other._found_at

    def take(self, findings: Findings, end_utc: float, since: float, compensated: bool) -> None:
        """Judge findings; what passes waits and takes the place of what waited.

        Args:
            findings: of the newest window.
            end_utc: end of the window, seconds since 1970.
            since: plant second of that.
            compensated: whether a block may have been in force during the window.
        """
        if self._found_at is not None and since <= self._found_at:
            compensated = True
        counted = self._agreement.count(findings)
        surest = self._agreement.as_surest(findings)
        candidate = Candidate(surest, end_utc, counted, since, compensated)
        self._drop_what_contradicts(findings)
        objection = self._permission.judge(candidate, since)
        if objection is not None:
            self._report(Attempt(objection.outcome, objection.reason, candidate))
            return
        waits = self._waiting.candidate
        if waits is not None and (waits.withdrawal or candidate.says_less_than(waits)):
            kept = "what waits is not touched by a window that cannot tell"
            self._report(Attempt(WritebackOutcome.KEPT_VALID, kept, candidate))
            return
        self._waiting.supersede(candidate)

    def follow_use(self, before: bool | None, in_use: bool | None, now: float) -> None:
        """Count windows again from here when the use of the block has changed."""
        if in_use and before is None:
            # Nobody looked before: the windows up to now may have been compensated.
            self._found_at = now
            self._waiting.mark_compensated()
        if in_use is not before:
            self._agreement.start_again()

    def _drop_what_contradicts(self, findings: Findings) -> None:
        """End the wait of what a newer window contradicts, whether or not that may be written."""
        waits = self._waiting.candidate
        if waits is not None and waits.is_contradicted_by(findings):
            self._waiting.put(None)
            self._report(Attempt(WritebackOutcome.CONTRADICTED, _in_words(findings), waits))


def _in_words(findings: Findings) -> str:
    verdict = findings.verdict.replace("_", " ")
    if findings.verdict != "stiction":
        return f"a newer window says {verdict}"
    return f"a newer window says {verdict} with S = {findings.stick_band.value:g}"
