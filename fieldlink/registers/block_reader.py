"""The reader of parameter blocks: the rules a PLC follows, as a pure state machine.

Call `BlockReader.scan` once per PLC scan with the exchange registers and the PLC's own seconds;
write `ReaderState.reply` back to the registers and use `ReaderState.in_force`. The reader keeps a
copy of the block it accepted: what happens to the registers later does not touch the model in use.

    no block --accepted--> in force --expired, withdrawn, cleared--> no block
                           in force <--disabled, heartbeat dead--> suspended

An expired or withdrawn block needs a new one. A dead heartbeat or a cleared enable bit suspends the
block: it is in force again when the cause ends, unless it has expired meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from fieldlink.registers.block_words import decode_block, read_seq
from fieldlink.registers.codes import (
    ACCEPTED,
    NOTHING_SEEN,
    BlockError,
    BlockFault,
    Refusal,
    Status,
)
from fieldlink.registers.exchange import Bank, ExchangeLayout, ExchangeWords, split_commit
from fieldlink.registers.heartbeat import HEARTBEAT_TIMEOUT
from fieldlink.registers.parameter_block import ParameterBlock, is_newer
from fieldlink.registers.types import Order
from loop_model import LoopModel

__all__ = ["BlockLimits", "BlockReader", "Fallback", "ReaderState"]


class Fallback(Enum):
    """Why no block is in force; the value is the text with advice."""

    NO_BLOCK = "no block was accepted yet"
    DISABLED = "the enable register is 0: the operator does not allow compensation"
    HEARTBEAT_DEAD = "Fieldlink's heartbeat does not count: check that it runs and reaches the PLC"
    EXPIRED = "the block is older than its valid-for time: a new window has to confirm it"
    WITHDRAWN = "an operator has withdrawn the block"
    CLEARED = "the block's bank reads all zero: the PLC or its Modbus server cleared it"


@dataclass(frozen=True, slots=True)
class BlockLimits:
    """The reader's own ranges, in units of OP; a block outside is rejected."""

    stick_band: tuple[float, float] = (0.0, math.inf)
    slip_jump: tuple[float, float] = (0.0, math.inf)

    def check(self, block: ParameterBlock) -> None:
        """Raise `BlockError` when the valve of a valid block is outside."""
        if block.status is not Status.VALID:
            return
        for name, value, (low, high) in (
            ("stick_band", block.stick_band.value, self.stick_band),
            ("slip_jump", block.slip_jump.value, self.slip_jump),
        ):
            if not low <= value <= high:
                detail = f"{name} = {value:g}, limits {low:g} to {high:g}"
                raise BlockError(BlockFault.OUT_OF_RANGE, detail)


@dataclass(frozen=True, slots=True)
class ReaderState:
    """What one scan found.

    Attributes:
        accepted: the block kept, with status valid or no stiction; None when there is none.
        ack_seq, ack_result, active_bank, ack_commit: the PLC's words of the exchange area.
        fallback: why ``accepted`` is not to be used now; None when it is in force.
        expires_in: seconds until ``accepted`` expires; 0 without one.
        detail: text of the last rejection, empty when the last block was accepted.
    """

    accepted: ParameterBlock | None = None
    ack_seq: int = 0
    ack_result: int = NOTHING_SEEN
    active_bank: Bank = Bank.A
    ack_commit: int = 0
    fallback: Fallback | None = Fallback.NO_BLOCK
    expires_in: float = 0.0
    detail: str = ""

    @property
    def in_force(self) -> ParameterBlock | None:
        """The block to act on now; None means: behave as without Fieldlink."""
        return self.accepted if self.fallback is None else None

    @property
    def model(self) -> LoopModel | None:
        """The model to compensate with now; None also when the valve is found healthy."""
        return None if self.in_force is None else self.in_force.model

    @property
    def expired(self) -> bool:
        """Whether the accepted block is too old."""
        return self.fallback is Fallback.EXPIRED

    @property
    def heartbeat_dead(self) -> bool:
        """Whether the heartbeat is what keeps the accepted block from being used."""
        return self.fallback is Fallback.HEARTBEAT_DEAD

    def reply(self, layout: ExchangeLayout, refusal: Refusal | None = None) -> Mapping[int, int]:
        """Return address and word of every register the PLC has to write.

        Args:
            layout: addresses.
            refusal: why the consumer does not use the accepted block's model; None if it does.
        """
        words = {
            layout.ack_seq: self.ack_seq,
            layout.ack_result: self.ack_result,
            layout.active_bank: int(self.active_bank),
            layout.ack_commit: self.ack_commit,
        }
        if layout.ack_refusal is not None:
            words[layout.ack_refusal] = 0 if refusal is None else refusal.code
        return words


class BlockReader:
    """The PLC's side of the exchange for one loop."""

    def __init__(
        self,
        loop_id: int,
        *,
        word_order: Order = "big",
        heartbeat_timeout: float = HEARTBEAT_TIMEOUT,
        limits: BlockLimits | None = None,
        age: Callable[[ParameterBlock], float] | None = None,
    ) -> None:
        """Begin without a block.

        Args:
            loop_id: only blocks with this id are accepted.
            word_order: of the 32-bit fields.
            heartbeat_timeout: PLC seconds without a change after which the heartbeat is dead.
            limits: the PLC's own ranges.
            age: seconds of its time that a block has had when it is accepted, for a reader that
                keeps nothing over its restart: else an expired block would start again. None
                where the reader is there from the block's commit on.
        """
        self._age = age or (lambda _block: 0.0)
        self._loop_id = loop_id
        self._word_order: Order = word_order
        self._heartbeat_timeout = heartbeat_timeout
        self._limits = limits or BlockLimits()
        self._accepted: ParameterBlock | None = None
        self._expires_at = -math.inf
        self._why_none = Fallback.NO_BLOCK
        self._judged: tuple[int, Sequence[int]] | None = None
        self._refused: int | None = None
        self._heartbeat: int | None = None
        self._alive_until = -math.inf
        self._ack_seq = 0
        self._ack_registers: Sequence[int] = ()
        self._ack_result = NOTHING_SEEN
        self._active_bank = Bank.A
        self._ack_commit = 0
        self._detail = ""
        self._now = -math.inf

    def scan(self, words: ExchangeWords, now_s: float) -> ReaderState:
        """Take one scan's registers at PLC time ``now_s`` and return what follows from them.

        Raises:
            ValueError: the PLC's time went backwards.
        """
        if now_s < self._now:
            raise ValueError(f"PLC time went back from {self._now} to {now_s} s; pass uptime")
        self._now = now_s
        self._watch_heartbeat(words.heartbeat)
        enabled = bool(words.enable & 1)
        if words.commit != self._refused:
            self._refused = None
        if not enabled and words.commit != self._ack_commit:
            # For good: what was committed against the operator's will is not taken up later.
            self._judged, self._refused = None, words.commit
            self._reject(words.commit, BlockError(BlockFault.NOT_ENABLED))
        elif enabled and self._refused is None:
            self._judge(words)
        if self._accepted is not None and not any(words.bank(self._active_bank)):
            self._drop(Fallback.CLEARED)
        if self._accepted is not None and now_s >= self._expires_at:
            self._drop(Fallback.EXPIRED)
        return ReaderState(
            accepted=self._accepted,
            ack_seq=self._ack_seq,
            ack_result=self._ack_result,
            active_bank=self._active_bank,
            ack_commit=self._ack_commit,
            fallback=self._fallback(enabled),
            expires_in=self._expires_at - now_s if self._accepted is not None else 0.0,
            detail=self._detail,
        )

    def _watch_heartbeat(self, heartbeat: int) -> None:
        """A heartbeat is alive once it was seen to change: a value left over is not life."""
        if self._heartbeat is not None and heartbeat != self._heartbeat:
            self._alive_until = self._now + self._heartbeat_timeout
        self._heartbeat = heartbeat

    def _judge(self, words: ExchangeWords) -> None:
        """Look at the committed bank unless exactly this was judged before."""
        try:
            bank, low_seq = split_commit(words.commit)
        except ValueError as error:
            self._reject(words.commit, BlockError(BlockFault.COMMIT, str(error)))
            return
        registers = words.bank(bank)
        if self._judged == (words.commit, registers):
            return
        try:
            if read_seq(registers) & 0xFF != low_seq:
                # The next block lies in the committed bank and its commit is still to come.
                return
            block = decode_block(registers, self._word_order)
            if registers != self._ack_registers:
                self._check(block)
        except BlockError as error:
            self._judged = (words.commit, registers)
            self._reject(words.commit, error)
            return
        self._judged = (words.commit, registers)
        if registers != self._ack_registers:
            self._accept(block, bank)
            self._ack_registers = registers
        self._ack_result = ACCEPTED
        self._ack_commit = words.commit
        self._detail = ""

    def _check(self, block: ParameterBlock) -> None:
        if block.loop_id != self._loop_id:
            detail = f"loop {block.loop_id}, this is {self._loop_id}"
            raise BlockError(BlockFault.WRONG_LOOP, detail)
        if not is_newer(block.seq, self._ack_seq):
            raise BlockError(BlockFault.NOT_NEWER, f"{block.seq} after {self._ack_seq}")
        self._limits.check(block)

    def _accept(self, block: ParameterBlock, bank: Bank) -> None:
        self._ack_seq = block.seq
        self._active_bank = bank
        if block.status in (Status.VALID, Status.NO_STICTION):
            self._accepted = block
            self._expires_at = self._now + block.valid_for - self._age(block)
        elif block.status is Status.WITHDRAWN:
            self._drop(Fallback.WITHDRAWN)

    def _reject(self, commit: int, error: BlockError) -> None:
        if error.reason is BlockFault.EMPTY and commit == 0:
            # Nothing was ever committed: an empty area is not a fault.
            return
        self._ack_result = error.reason.code
        self._ack_commit = commit
        self._detail = str(error)

    def _drop(self, why: Fallback) -> None:
        self._accepted = None
        self._expires_at = -math.inf
        self._why_none = why

    def _fallback(self, enabled: bool) -> Fallback | None:
        if self._accepted is None:
            return self._why_none
        if not enabled:
            return Fallback.DISABLED
        if self._now >= self._alive_until:
            return Fallback.HEARTBEAT_DEAD
        return None
