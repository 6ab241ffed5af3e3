"""Committed blocks whose outcome is open: of this process, and of one that ended before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fieldlink.daemon.writeback.acknowledgement import Acknowledgement
from fieldlink.daemon.writeback.block_use import BlockUse
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.handover import Handover
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.waiting import Waiting
from fieldlink.links import LinkError
from fieldlink.registers import BlockFault, commit_word

__all__ = ["Unsettled"]

_NO_WHOLE_BLOCK = frozenset(
    fault.code
    for fault in (
        BlockFault.EMPTY,
        BlockFault.MAGIC,
        BlockFault.VERSION,
        BlockFault.CRC,
        BlockFault.SEQ_TORN,
    )
)
"""Answers of a PLC to registers that are not the block as it was written."""


class Unsettled:
    """Finds out the outcome of blocks, one at a time.

    Args:
        period: plant seconds of the loop's period.
        handover: looks for a block in the PLC.
        use: takes note of an accepted block.
        waiting: takes back what may be tried again.
        report: called with every outcome.
    """

    def __init__(
        self,
        period: float,
        handover: Handover,
        use: BlockUse,
        waiting: Waiting,
        report: Callable[[Attempt], None],
    ) -> None:
        self._handover = handover
        self._use = use
        self._waiting = waiting
        self._report = report
        self._acknowledgement = Acknowledgement(period)
        self._left: Attempt | None = None

    @property
    def is_awaited(self) -> bool:
        """Whether the PLC's answer to a commit is open."""
        return self._acknowledgement.is_awaited

    def carry_over(self, other: Unsettled, under_way: Attempt | None) -> None:
        """Go on where another one was.

        Args:
            other: of the writer before.
            under_way: what that writer had begun to write: it is looked for in the PLC.
        """
        self._acknowledgement.carry_over(other._acknowledgement)
        self._left = under_way or other._left

    def leave(self, attempt: Attempt) -> None:
        """Take over what another process left open."""
        self._left = attempt

    def expect(self, attempt: Attempt) -> None:
        """Wait for the PLC's answer to a commit."""
        self._acknowledgement.expect(attempt)

    async def look_back(self, control: ControlWords) -> bool:
        """Complete the record of what was left open; return whether that was committed.

        Raises:
            LinkError: the PLC's bank could not be read.
        """
        left = self._left
        if left is None:
            return False
        found = await self._handover.look_back(left, control)
        self._left = None
        committed = found.outcome is WritebackOutcome.COMMITTED
        if committed:
            self._acknowledgement.expect(found)
        elif found.candidate.withdrawal:
            self._waiting.put(found.candidate)
        if found.outcome is not left.outcome:
            self._report(found)
        return committed

    async def look_for_answer(self, control: ControlWords, now: float) -> None:
        """Take the PLC's answer to a committed block."""
        found = self._acknowledgement.look(control, now)
        if found is None:
            return
        spoilt = ""
        if found.outcome is WritebackOutcome.REJECTED and control.ack_result in _NO_WHOLE_BLOCK:
            found, spoilt = await self._look_at_bank(found)
        if found.outcome is WritebackOutcome.ACCEPTED and found.block is not None:
            self._use.in_force.accept(found.block, now)
            # What a failed commit left waiting has arrived after all.
            self._waiting.clear(found.candidate)
        elif found.outcome is WritebackOutcome.REJECTED:
            if control.ack_result == BlockFault.NOT_ENABLED.code:
                # Not the finding was refused: it is judged again and gets a new number.
                self._wait_again(found.candidate, WritebackOutcome.NOT_ENABLED)
            elif found.candidate.withdrawal or (spoilt and not found.candidate.was_offered):
                self._offer_again(found)
        elif found.candidate.withdrawal and not _is_committed(found, control):
            self._offer_again(found)
        self._report(found)

    async def _look_at_bank(self, rejected: Attempt) -> tuple[Attempt, str]:
        """Find out who is to blame for a block that the PLC could not read.

        Returns:
            The attempt with that as part of its reason, and how the bank differs from what was
            written; empty when it does not.
        """
        spoilt = ""
        try:
            spoilt = await self._handover.differences(rejected)
        except LinkError as error:
            found = f"the bank could not be read again: {error}"
        else:
            found = (
                f"since the commit another client or the PLC's program wrote to the bank: {spoilt}"
                if spoilt
                else "the bank holds what was written: compare the PLC's block reader with ours"
            )
        return rejected.became(rejected.outcome, f"{rejected.reason}; {found}"), spoilt

    def _wait_again(self, candidate: Candidate, why: WritebackOutcome) -> None:
        """Let a candidate wait for another attempt, unless a newer one waits."""
        if self._waiting.candidate is None:
            self._waiting.put(candidate, why)

    def _offer_again(self, attempt: Attempt) -> None:
        """Let wait what the PLC has not taken: a withdrawal, or a block that somebody has spoilt.

        The block before it is in force.
        """
        self._wait_again(replace(attempt.candidate, was_offered=True), attempt.outcome)


def _is_committed(attempt: Attempt, control: ControlWords) -> bool:
    """Whether the PLC still has the commit word: then it accepts the block when it looks."""
    assert attempt.block is not None
    assert attempt.bank is not None
    return control.commit == commit_word(attempt.bank, attempt.block.seq)
