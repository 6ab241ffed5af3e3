"""The turn of what waits: permission, both banks, permission to replace; then an attempt begins."""

from __future__ import annotations

from collections.abc import Callable

from fieldlink.daemon.writeback.block_use import BlockUse
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.handover import Handover
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.permission import WritePermission
from fieldlink.daemon.writeback.recorded_handover import RecordedHandover
from fieldlink.daemon.writeback.rules import Objection
from fieldlink.daemon.writeback.telling import ToldOnce
from fieldlink.daemon.writeback.waiting import Waiting
from fieldlink.links import LinkError

__all__ = ["Turn"]


class Turn:
    """Begins at most one attempt at a look.

    Args:
        handover: reads the banks.
        permission: says whether the candidate may be written now.
        use: what the PLC has in force.
        waiting: holds the candidate.
        recorded: plans the block and carries it out.
        told: logs an event, once.
        report: called with every decision.
    """

    def __init__(
        self,
        handover: Handover,
        permission: WritePermission,
        use: BlockUse,
        waiting: Waiting,
        recorded: RecordedHandover,
        told: ToldOnce,
        report: Callable[[Attempt], None],
    ) -> None:
        self._handover = handover
        self._permission = permission
        self._use = use
        self._waiting = waiting
        self._recorded = recorded
        self._told = told
        self._report = report

    async def take(
        self, candidate: Candidate, control: ControlWords, now: float, not_before: float
    ) -> bool:
        """Begin an attempt with a candidate that waits, or say why it waits or is given up.

        Returns:
            Whether the device answered all that it was asked.

        Args:
            candidate: what waits.
            control: the single words as read now.
            now: the plant second.
            not_before: plant second of the earliest attempt.
        """
        objection = self._permission.before_turn(candidate, control, now, not_before)
        if objection is not None:
            self._waiting.heed(objection, candidate)
            return True
        try:
            banks = await self._handover.banks(control)
        except LinkError as error:
            self._waiting.explain(WritebackOutcome.UNREACHABLE, str(error))
            self._waiting.note_end(Attempt(WritebackOutcome.UNREACHABLE, str(error), candidate))
            return False
        if self._waiting.candidate is not candidate:
            # A newer window came while the banks were read: the next look is for that.
            return True
        if banks.disagreement:
            advice = WritebackOutcome.DISAGREES.advice
            self._told.tell("writeback.disagrees", f"{banks.disagreement}; {advice}")
            self._waiting.explain(WritebackOutcome.DISAGREES, banks.disagreement)
            return True
        self._told.forget("writeback.disagrees")
        if control.ack_seq and not any(banks.active_words):
            # A reader drops a block whose bank reads all zero.
            self._use.in_force.lose()
        if (objection := self._permission.to_replace(candidate, now)) is not None:
            self._decline(candidate, objection, banks.active_words, now)
            return True
        valve = self._use.in_force.valve(now)
        if candidate.compensated and not candidate.withdrawal and valve is not None:
            candidate = candidate.confirming(valve)
        self._recorded.begin(candidate, control, banks, now)
        self._waiting.candidate = None
        return True

    def _decline(
        self, candidate: Candidate, objection: Objection, active: tuple[int, ...], now: float
    ) -> None:
        """Give up a candidate that must not replace what the PLC has."""
        contradicts = objection.outcome is WritebackOutcome.CONTRADICTS_BLOCK
        if contradicts and self._use.in_force.valve(now) is not None:
            self._told.tell(
                "writeback.experiment_wanted", f"{objection.reason}; {objection.outcome.advice}"
            )
        self._waiting.clear(candidate)
        self._report(Attempt(objection.outcome, objection.reason, candidate, active_before=active))
