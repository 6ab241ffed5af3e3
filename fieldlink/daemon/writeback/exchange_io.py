"""The exchange area of one loop over a link: the words of both sides, the banks, the commit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from fieldlink.links import ExceptionCode, ExceptionReplyError, LinkError, RegisterAccess
from fieldlink.registers import (
    ACCEPTED,
    BLOCK_REGISTERS,
    Bank,
    BlockError,
    DataType,
    ExchangeLayout,
    Order,
    ParameterBlock,
    ReadRequest,
    Table,
    Tag,
    commit_word,
    decode_block,
    encode_block,
    plan_reads,
    split_commit,
)

__all__ = ["ControlWords", "Exchange", "NoAreaError"]

Range = tuple[int, int]

_OPTIONAL = frozenset({"ack_refusal", "writer"})

_ONE_REQUEST = (
    f"a block is written as {BLOCK_REGISTERS} registers in one request (FC16), so that no reader "
    "sees half of it: let the PLC and the gateways before it take that, or remove the loop's "
    "writeback"
)
_ONE_REGISTER = (
    "heartbeat, writer and commit are written one register at a time (FC6): let the PLC and the "
    "gateways before it take that, or remove the loop's writeback"
)
_NO_REGISTERS = (
    "the exchange area has registers that the device does not have: reserve them in the PLC, or "
    "correct the loop's writeback.base or writeback.addresses"
)


class NoAreaError(LinkError):
    """What was read is not an exchange area: conclude nothing from it, write nothing."""


@dataclass(frozen=True, slots=True)
class ControlWords:
    """The single words of an exchange area, read at one time; None for one that it has not."""

    enable: int
    ack_seq: int
    ack_result: int
    active_bank: int
    ack_commit: int
    heartbeat: int
    commit: int
    ack_refusal: int | None = None
    writer: int | None = None

    @property
    def blank(self) -> bool:
        """Whether every word is zero, as in a PLC that starts again; no operator did that."""
        return not any(self._there)

    @property
    def filler(self) -> int | None:
        """The number that every word holds, as from a gateway that has lost its PLC; else None.

        A real area never looks so: enable bit, commit word and answers have different values.
        """
        return self.enable if self.enable and len(set(self._there)) == 1 else None

    @property
    def _there(self) -> tuple[int, ...]:
        words = (getattr(self, name) for name in self.__dataclass_fields__)
        return tuple(word for word in words if word is not None)

    @property
    def names_a_bank(self) -> bool:
        """Whether the PLC names one of the banks as active: every PLC does, from its start on."""
        return self.active_bank in (Bank.A, Bank.B)

    @property
    def enabled(self) -> bool:
        """Whether the operator allows blocks to be written."""
        return bool(self.enable & 1)

    @property
    def inactive_bank(self) -> Bank:
        """The bank that is not in use: where the next block goes.

        It is the one that the PLC does not name as active; before the PLC has accepted anything,
        the one that the commit word does not name.
        """
        if self.ack_seq != 0 and self.names_a_bank:
            return Bank(self.active_bank).other
        try:
            return split_commit(self.commit)[0].other
        except ValueError:
            return Bank.A

    @property
    def disagreement(self) -> str:
        """Say how acknowledgement and commit contradict each other; empty when they do not."""
        if not self.names_a_bank:
            return f"active_bank is {self.active_bank}, which is not a bank"
        if self.ack_seq == 0:
            return ""
        if self.ack_result != ACCEPTED or self.ack_commit != self.commit:
            return ""
        said = commit_word(Bank(self.active_bank), self.ack_seq)
        if said == self.commit:
            return ""
        return (
            f"the PLC accepted commit {self.commit:#06x}, and its active_bank {self.active_bank} "
            f"and ack_seq {self.ack_seq} belong to {said:#06x}"
        )


class Exchange:
    """Reads and writes one loop's exchange area; every method raises `LinkError`.

    Args:
        access: the device's registers.
        layout: the area.
        word_order: of the fields of a block that are longer than a register.
        device: the device's name, for messages.
        max_gap: unused registers read along between two words, where they are readable.
        readable: declared readable ranges (first, last), both included.
    """

    def __init__(
        self,
        access: RegisterAccess,
        layout: ExchangeLayout,
        word_order: Order,
        *,
        device: str,
        max_gap: int = 0,
        readable: Sequence[Range] = (),
    ) -> None:
        self._access = access
        self._layout = layout
        self._word_order: Order = word_order
        self._device = device
        addresses = {name: getattr(layout, name) for name in ControlWords.__dataclass_fields__}
        there = {name: address for name, address in addresses.items() if address is not None}
        needed = {name: address for name, address in there.items() if name not in _OPTIONAL}
        self._plan = _plan(there, max_gap, readable)
        self._least = None if there == needed else _plan(needed, max_gap, readable)
        self.requests = 0

    async def control(self) -> ControlWords:
        """Read the single words.

        A PLC of an earlier layout refuses the optional ones; they are not asked for again.

        Raises:
            NoAreaError: all of them hold one number that is not zero.
        """
        found = await self._any_control()
        if found.filler is not None:
            raise NoAreaError(
                self._device,
                f"all words of the exchange area read {found.filler}, which no PLC program gives",
                "nothing is written meanwhile; check whether a gateway has lost its PLC",
            )
        return found

    async def _any_control(self) -> ControlWords:
        try:
            return await self._control(self._plan)
        except ExceptionReplyError as refusal:
            if self._least is None or not refusal.code.blames_an_address:
                raise
            found = await self._control(self._least)
        try:
            # Exceptions may have ended just now, as after a program download.
            return await self._control(self._plan)
        except ExceptionReplyError as refusal:
            if not refusal.code.blames_an_address:
                raise
            self._plan, self._least = self._least, None
        return found

    async def _control(self, plan: Sequence[ReadRequest]) -> ControlWords:
        found: dict[str, int] = {}
        for request in plan:
            words = await self._read(request.address, request.count)
            for tag in request.tags:
                found[tag.name] = request.words_of(tag, words)[0]
        return ControlWords(**found)

    async def bank(self, bank: Bank) -> tuple[int, ...]:
        """Read a whole bank in one request."""
        return tuple(await self._read(self._layout.bank_address(bank), BLOCK_REGISTERS))

    async def write_bank(self, bank: Bank, words: Sequence[int]) -> None:
        """Write a whole bank in one request."""
        with _advised(_ONE_REQUEST):
            self.requests += 1
            await self._access.write_registers(self._layout.bank_address(bank), words)

    async def commit(self, bank: Bank, seq: int) -> None:
        """Make the block ``seq`` in ``bank`` the one to use."""
        await self._write_one(self._layout.commit, commit_word(bank, seq))

    async def beat(self, heartbeat: int) -> None:
        """Write the heartbeat."""
        await self._write_one(self._layout.heartbeat, heartbeat)

    async def sign(self, identity: int) -> None:
        """Write the identity of the installation that writes."""
        assert self._layout.writer is not None
        await self._write_one(self._layout.writer, identity)

    def decode(self, words: Sequence[int]) -> ParameterBlock | None:
        """Return the block in the registers of a bank; None when they hold none."""
        try:
            return decode_block(words, self._word_order)
        except BlockError:
            return None

    def encode(self, block: ParameterBlock) -> list[int]:
        """Return the registers of a block in the device's word order."""
        return encode_block(block, self._word_order)

    async def _write_one(self, address: int, word: int) -> None:
        with _advised(_ONE_REGISTER):
            self.requests += 1
            await self._access.write_register(address, word)

    async def _read(self, address: int, count: int) -> list[int]:
        self.requests += 1
        try:
            return await self._access.read_registers(address, count)
        except ExceptionReplyError as error:
            if error.code is ExceptionCode.ILLEGAL_ADDRESS:
                # These registers are in no map.
                advice = _NO_REGISTERS
            elif error.code is ExceptionCode.ILLEGAL_VALUE and count >= BLOCK_REGISTERS:
                # A bank is compared as a whole: it cannot be read in parts.
                advice = (
                    f"a block is read back as {count} registers in one request: check that they "
                    "exist; if the device refuses so many, remove the loop's writeback"
                )
            else:
                raise
            raise ExceptionReplyError(
                error.device, error.request, error.number, advice=advice
            ) from error


@contextmanager
def _advised(advice: str) -> Iterator[None]:
    """Say which function and length the contract needs, where a device refuses them."""
    try:
        yield
    except ExceptionReplyError as error:
        if error.code not in (ExceptionCode.ILLEGAL_FUNCTION, ExceptionCode.ILLEGAL_VALUE):
            raise
        raise ExceptionReplyError(
            error.device, error.request, error.number, is_write=True, advice=advice
        ) from error


def _plan(
    addresses: Mapping[str, int], max_gap: int, readable: Sequence[Range]
) -> list[ReadRequest]:
    """Plan the reads of the single words.

    Registers between them are read along only where the site file declares them readable.
    """
    first, last = min(addresses.values()), max(addresses.values())
    declared = any(low <= first and last <= high for low, high in readable)
    tags = [
        Tag(name, Table.HOLDING, address, DataType.UINT16) for name, address in addresses.items()
    ]
    return list(plan_reads(tags, max_gap if declared else 0))
