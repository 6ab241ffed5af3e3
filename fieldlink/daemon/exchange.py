"""The exchange area of one loop over a link: the words of both sides, the banks, the commit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fieldlink.links import RegisterAccess
from fieldlink.registers import (
    BLOCK_REGISTERS,
    Bank,
    BlockError,
    ExchangeLayout,
    Order,
    ParameterBlock,
    commit_word,
    decode_block,
    encode_block,
    split_commit,
)

__all__ = ["ControlWords", "Exchange"]


@dataclass(frozen=True, slots=True)
class ControlWords:
    """The single words of an exchange area, read at one time."""

    enable: int
    ack_seq: int
    ack_result: int
    active_bank: int
    ack_commit: int
    heartbeat: int
    commit: int

    @property
    def enabled(self) -> bool:
        """Whether the operator allows blocks to be written."""
        return bool(self.enable & 1)

    @property
    def inactive_bank(self) -> Bank:
        """The bank whose content nobody uses: where the next block goes.

        It is the one that the PLC does not name as active; before the PLC has accepted anything,
        the one that the commit word does not name.
        """
        if self.ack_seq != 0 and self.active_bank in (Bank.A, Bank.B):
            return Bank(self.active_bank).other
        try:
            return split_commit(self.commit)[0].other
        except ValueError:
            return Bank.A


class Exchange:
    """Reads and writes one loop's exchange area; every method raises `LinkError`.

    Args:
        access: the device's registers.
        layout: the area.
        word_order: of the 32-bit fields of a block.
    """

    def __init__(self, access: RegisterAccess, layout: ExchangeLayout, word_order: Order) -> None:
        self._access = access
        self._layout = layout
        self._word_order: Order = word_order
        self._names = {getattr(layout, name): name for name in ControlWords.__dataclass_fields__}
        self._runs = _runs(sorted(self._names))
        self.requests = 0

    async def control(self) -> ControlWords:
        """Read the single words; only registers of the area, nothing between them."""
        words: dict[str, int] = {}
        for first, count in self._runs:
            for offset, word in enumerate(await self._read(first, count)):
                words[self._names[first + offset]] = word
        return ControlWords(**words)

    async def bank(self, bank: Bank) -> tuple[int, ...]:
        """Read a whole bank in one request."""
        return tuple(await self._read(self._layout.bank_address(bank), BLOCK_REGISTERS))

    async def write_bank(self, bank: Bank, words: Sequence[int]) -> None:
        """Write a whole bank in one request."""
        self.requests += 1
        await self._access.write_registers(self._layout.bank_address(bank), words)

    async def commit(self, bank: Bank, seq: int) -> None:
        """Make the block ``seq`` in ``bank`` the one to use."""
        self.requests += 1
        await self._access.write_register(self._layout.commit, commit_word(bank, seq))

    async def beat(self, heartbeat: int) -> None:
        """Write the heartbeat."""
        self.requests += 1
        await self._access.write_register(self._layout.heartbeat, heartbeat)

    def decode(self, words: Sequence[int]) -> ParameterBlock | None:
        """Return the block in the registers of a bank; None when they hold none."""
        try:
            return decode_block(words, self._word_order)
        except BlockError:
            return None

    def encode(self, block: ParameterBlock) -> list[int]:
        """Return the registers of a block in the device's word order."""
        return encode_block(block, self._word_order)

    async def _read(self, address: int, count: int) -> list[int]:
        self.requests += 1
        return await self._access.read_registers(address, count)


def _runs(addresses: Sequence[int]) -> list[tuple[int, int]]:
    """Return (first, count) of every run of neighbours in sorted addresses."""
    runs: list[tuple[int, int]] = []
    for address in addresses:
        if runs and sum(runs[-1]) == address:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        else:
            runs.append((address, 1))
    return runs
