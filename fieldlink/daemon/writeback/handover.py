"""One block into one loop's exchange area: the steps, without the rules of when and whether.

    read both banks - plan the block - (its record is stored) - write the inactive bank (one FC16) -
    read it back, once more if it differs - commit (one FC6)

A step that fails ends it and leaves the active bank as it was. What a daemon before this one had
begun is found out by looking at what the PLC holds.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.links import LinkError
from fieldlink.registers import Bank, ParameterBlock, commit_word, is_newer, next_seq
from fieldlink.store import WritebackRecord

__all__ = ["Banks", "Handover"]


@dataclass(frozen=True, slots=True)
class Banks:
    """Both banks as read before a write."""

    target: Bank
    target_words: tuple[int, ...]
    active_words: tuple[int, ...]
    active: ParameterBlock | None


class Handover:
    """Writes blocks and knows the newest sequence number of PLC, banks and this process.

    Args:
        exchange: the exchange area.
        loop_id: as the PLC knows the loop.
        valid_for: seconds that a block is valid.
        pause: waits one scan of the PLC before a second read-back.

    Attributes:
        last_seq: the newest sequence number known.
    """

    def __init__(
        self,
        exchange: Exchange,
        *,
        loop_id: int,
        valid_for: int,
        pause: Callable[[], Awaitable[None]],
    ) -> None:
        self._exchange = exchange
        self._loop_id = loop_id
        self._valid_for = valid_for
        self._pause = pause
        self.last_seq = 0

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
                self._know(known.seq)
        if control.ack_seq:
            self._know(control.ack_seq)
        if active is not None and active.seq != control.ack_seq:
            active = None
        return Banks(target, target_words, active_words, active)

    def plan(self, candidate: Candidate, control: ControlWords, banks: Banks) -> Attempt:
        """Return what is about to be written, with a sequence number of its own."""
        self.last_seq = next_seq(self.last_seq)
        block = candidate.block(self._loop_id, self.last_seq, self._valid_for)
        return Attempt(
            WritebackOutcome.BEGUN,
            f"{control.commit:#06x} was committed before",
            candidate,
            block,
            tuple(self._exchange.encode(block)),
            banks.target,
            banks.target_words,
            banks.active_words,
        )

    async def carry_out(self, begun: Attempt) -> Attempt:
        """Write, read back and commit what was planned; return what came of it."""
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
            differing = [i for i, (a, b) in enumerate(zip(words, back, strict=True)) if a != b]
            return begun.became(
                WritebackOutcome.READBACK_DIFFERS,
                f"{len(differing)} registers differ, the first at offset {differing[0]}",
            )
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
        self._know(block.seq)
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
                WritebackOutcome.COMMITTED, "found in the PLC when the daemon began again"
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

    def _know(self, seq: int) -> None:
        if is_newer(seq, self.last_seq):
            self.last_seq = seq
