"""One block into one loop's exchange area: the steps, without the rules of when and whether.

    read both banks - plan the block - (its record is stored) - write the inactive bank (one FC16) -
    read it back, once more if it differs - read the single words again - commit (one FC6)

A step that fails ends it and leaves the active bank as it was. The outcome of a write
that an earlier daemon left unfinished is read from the PLC.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

from fieldlink.daemon.writeback.bank_differences import describe_differences
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.rules import Objection
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.links import LinkError
from fieldlink.registers import Bank, commit_word
from fieldlink.store import WritebackRecord

__all__ = ["Banks", "Handover"]


@dataclass(frozen=True, slots=True)
class Banks:
    """Both banks as read before a write; ``disagreement`` says how they contradict the PLC."""

    target: Bank
    target_words: tuple[int, ...]
    active_words: tuple[int, ...]
    disagreement: str


class Handover:
    """Writes blocks and knows the newest sequence number of PLC, banks and this process.

    Args:
        exchange: the exchange area.
        loop_id: as the PLC knows the loop.
        valid_for: seconds that a block is valid.
        pause: waits one scan of the PLC before a second read-back.
        numbers: the loop's sequence numbers.
    """

    def __init__(
        self,
        exchange: Exchange,
        *,
        loop_id: int,
        valid_for: int,
        pause: Callable[[], Awaitable[None]],
        numbers: SequenceNumbers,
    ) -> None:
        self._exchange = exchange
        self._loop_id = loop_id
        self._valid_for = valid_for
        self._pause = pause
        self._numbers = numbers

    async def banks(self, control: ControlWords) -> Banks:
        """Read both banks.

        Raises:
            LinkError: they could not be read.
        """
        target = control.inactive_bank
        active_words = await self._exchange.bank(target.other)
        target_words = await self._exchange.bank(target)
        active = self._exchange.decode(active_words)
        for known in (active, self._exchange.decode(target_words)):
            if known is not None:
                self._numbers.learn(known.seq)
        self._numbers.learn(control.ack_seq)
        found = control.disagreement
        held = 0 if active is None else active.seq
        if not found and control.ack_seq and any(active_words) and held != control.ack_seq:
            found = (
                f"the PLC acknowledges block {control.ack_seq} in bank {target.other.name}, "
                f"which holds {f'block {held}' if held else 'no block'}"
            )
        return Banks(target, target_words, active_words, found)

    def plan(self, candidate: Candidate, control: ControlWords, banks: Banks) -> Attempt:
        """Return what is about to be written, with a sequence number of its own."""
        seq = self._numbers.take(banks.target, control.commit)
        block = candidate.block(self._loop_id, seq, self._valid_for)
        return Attempt(
            WritebackOutcome.BEGUN,
            f"the commit word before it was {control.commit:#06x}",
            candidate,
            block,
            tuple(self._exchange.encode(block)),
            banks.target,
            banks.target_words,
            banks.active_words,
        )

    async def carry_out(
        self, begun: Attempt, object_to: Callable[[ControlWords], Objection | None]
    ) -> Attempt:
        """Write, read back and commit what was planned; return the outcome.

        Args:
            begun: what was planned.
            object_to: says, by the single words as read just before the commit, why there must be
                none; None when there may.
        """
        assert begun.block is not None
        assert begun.words is not None
        assert begun.bank is not None
        words, bank = begun.words, begun.bank
        try:
            await self._exchange.write_bank(bank, words)
            back = await self._exchange.bank(bank)
            if back != words:
                await self._pause()
                back = await self._exchange.bank(bank)
        except LinkError as error:
            return begun.became(WritebackOutcome.WRITE_FAILED, str(error))
        if back != words:
            return begun.became(
                WritebackOutcome.READBACK_DIFFERS,
                describe_differences(words, back, begun.bank_before),
            )
        try:
            control = await self._exchange.control()
        except LinkError as error:
            return begun.became(WritebackOutcome.WRITE_FAILED, str(error))
        objection = object_to(control)
        if objection is not None:
            return begun.became(objection.outcome, objection.reason)
        try:
            await self._exchange.commit(bank, begun.block.seq)
        except LinkError as error:
            return begun.became(WritebackOutcome.COMMIT_FAILED, str(error))
        return replace(begun, outcome=WritebackOutcome.COMMITTED)

    def recall(self, record: WritebackRecord) -> Attempt | None:
        """Return the attempt behind a stored row; None when the row holds no block."""
        words = tuple(record.words or ())
        block = self._exchange.decode(words)
        if block is None or record.bank is None:
            return None
        self._numbers.learn(block.seq)
        return Attempt(
            WritebackOutcome.of(record.outcome),
            "",
            Candidate.of_block(block),
            block,
            words,
            Bank[record.bank],
            None if record.bank_before is None else tuple(record.bank_before),
            None if record.active_before is None else tuple(record.active_before),
        )

    async def differences(self, attempt: Attempt) -> str:
        """Say how the bank of a committed attempt differs from what was written; empty: not.

        Raises:
            LinkError: the bank could not be read.
        """
        assert attempt.words is not None
        assert attempt.bank is not None
        return describe_differences(attempt.words, await self._exchange.bank(attempt.bank))

    async def look_back(self, attempt: Attempt, control: ControlWords) -> Attempt:
        """Return what the PLC shows of an attempt that another process had begun.

        Raises:
            LinkError: the bank could not be read.
        """
        assert attempt.block is not None
        assert attempt.bank is not None
        word = commit_word(attempt.bank, attempt.block.seq)
        if control.ack_seq == attempt.block.seq or word in (control.commit, control.ack_commit):
            return attempt.became(
                WritebackOutcome.COMMITTED, "found in the PLC when the daemon started again"
            )
        held = await self._exchange.bank(attempt.bank)
        if held == attempt.words:
            what = "whole"
        elif held == attempt.bank_before:
            what = "not there"
        else:
            what = "not there, the bank holds another"
        return attempt.became(
            WritebackOutcome.INTERRUPTED,
            f"the block is {what}; committed is {control.commit:#06x}",
        )
