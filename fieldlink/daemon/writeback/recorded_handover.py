"""An attempt from its row in the store to its commit: nothing is written before its row is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.handover import Banks, Handover
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.permission import WritePermission
from fieldlink.daemon.writeback.rules import Objection
from fieldlink.daemon.writeback.waiting import Waiting

__all__ = ["Receipt", "RecordedHandover"]

RECORD_WAIT = 60.0
"""Plant seconds after which it is reported that a block waits for the store."""


class Receipt(Protocol):
    """The promise that a row will be in the store."""

    def done(self) -> bool:
        """Whether that has been settled."""
        ...

    def result(self) -> bool:
        """Whether the row is there."""
        ...


@dataclass(frozen=True, slots=True)
class _Begun:
    """An attempt whose row is on its way into the store, since a plant second."""

    attempt: Attempt
    receipt: Receipt
    since: float
    contradicted: bool = False


class RecordedHandover:
    """Carries out at most one attempt at a time.

    Args:
        handover: writes the block.
        permission: asked again at every step.
        waiting: takes a candidate back that may be tried again.
        keep: called with an attempt before anything of it is written; promises its row.
    """

    def __init__(
        self,
        handover: Handover,
        permission: WritePermission,
        waiting: Waiting,
        keep: Callable[[Attempt], Receipt],
    ) -> None:
        self._handover = handover
        self._permission = permission
        self._waiting = waiting
        self._keep = keep
        self._begun: _Begun | None = None
        self._under_way: Attempt | None = None

    @property
    def is_begun(self) -> bool:
        """Whether an attempt has begun and is not settled."""
        return self._begun is not None

    @property
    def under_way(self) -> Attempt | None:
        """What is being written at this moment."""
        return self._under_way

    def begin(self, candidate: Candidate, control: ControlWords, banks: Banks, now: float) -> None:
        """Plan a block and hand its row to the store."""
        attempt = self._handover.plan(candidate, control, banks)
        self._begun = _Begun(attempt, self._keep(attempt), now)

    def contradict(self, findings: Findings) -> None:
        """Stop an attempt that newer findings contradict; nothing of it is written."""
        begun = self._begun
        if begun is not None and begun.attempt.candidate.is_contradicted_by(findings):
            self._begun = replace(begun, contradicted=True)

    def give_up(self) -> tuple[Attempt, bool] | None:
        """Return what was planned and not begun to be written, and whether it may wait again."""
        if self._begun is None or self._under_way is not None:
            return None
        planned = self._begun.attempt.became(
            WritebackOutcome.INTERRUPTED, "the site was read again"
        )
        return planned, not self._begun.contradicted

    async def go_on(self, control: ControlWords, now: float) -> Attempt | None:
        """Write what was begun once its row is in the store; None while that is open."""
        begun = self._begun
        if begun is None:
            return None
        attempt = begun.attempt
        if not begun.receipt.done():
            if now - begun.since > RECORD_WAIT:
                late = "its row is not stored yet"
                self._waiting.explain_attempt(attempt.became(WritebackOutcome.NOT_RECORDED, late))
            return None
        if not begun.receipt.result():
            done = attempt.became(WritebackOutcome.NOT_RECORDED, "the store did not take its row")
        elif (objection := self._objection_at(control, attempt, now)) is not None:
            done = attempt.became(objection.outcome, objection.reason)
        else:
            self._under_way = attempt
            done = await self._handover.carry_out(
                attempt, lambda found: self._objection_at(found, attempt, now)
            )
            self._under_way = None
        contradicted = self._begun is not None and self._begun.contradicted
        self._begun = None
        if done.outcome.leaves_pending and self._waiting.candidate is None and not contradicted:
            self._waiting.put(attempt.candidate, done.outcome)
        return done

    def _objection_at(
        self, control: ControlWords, attempt: Attempt, now: float
    ) -> Objection | None:
        """Return why an attempt must not go on, by what is known at this moment."""
        if self._begun is not None and self._begun.contradicted:
            return Objection(WritebackOutcome.CONTRADICTED, "")
        return self._permission.to_go_on(attempt, control, now)
