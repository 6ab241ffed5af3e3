"""The exchange area: the holding registers through which one loop's blocks pass.

| register | written by | holds |
| --- | --- | --- |
| enable | PLC | bit 0: the operator allows blocks to be written and used |
| ack_seq | PLC | sequence number of the block last accepted, 0 when none |
| ack_result | PLC | outcome of the block last committed (`fieldlink.registers.codes`) |
| active_bank | PLC | bank of the block last accepted |
| ack_commit | PLC | the commit word that ack_result is about |
| ack_refusal | PLC | why the consumer refuses or gave up the model of ack_seq (`Refusal`) |
| heartbeat | Fieldlink | counts while Fieldlink lives |
| commit | Fieldlink | bank in the high byte, low byte of the block's seq in the low byte |
| writer | Fieldlink | identity of the installation that writes; optional |
| bank_a, bank_b | Fieldlink | a block each |

A writer puts the next block into the bank that is not active, or, before any block was accepted,
into the one that ``commit`` does not name. All zero is therefore a valid start: bank A is
committed and empty, the first block goes to bank B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum

from fieldlink.registers.block_layout import BLOCK_REGISTERS

__all__ = ["Bank", "ExchangeLayout", "ExchangeWords", "commit_word", "split_commit"]

_BANK_A_OFFSET = 10
_BANK_B_OFFSET = 110


class Bank(IntEnum):
    """One of the two places for a block."""

    A = 0
    B = 1

    @property
    def other(self) -> Bank:
        """The bank that is not this one."""
        return Bank(1 - self)


def commit_word(bank: Bank, seq: int) -> int:
    """Return the word that commits the block ``seq`` in ``bank``."""
    return (bank << 8) | (seq & 0xFF)


def split_commit(word: int) -> tuple[Bank, int]:
    """Return the bank and the low byte of the sequence number that a commit word names.

    Raises:
        ValueError: the high byte names no bank.
    """
    if word >> 8 not in (Bank.A, Bank.B):
        raise ValueError(
            f"commit word 16#{word:04X} names no bank; its high byte is 0 (A) or 1 (B)"
        )
    return Bank(word >> 8), word & 0xFF


@dataclass(frozen=True, slots=True)
class ExchangeWords:
    """The registers of one exchange area that a reader of blocks needs, as read in one PLC scan."""

    enable: int
    heartbeat: int
    commit: int
    bank_a: tuple[int, ...]
    bank_b: tuple[int, ...]

    def bank(self, bank: Bank) -> tuple[int, ...]:
        """Return the registers of a bank."""
        return self.bank_a if bank is Bank.A else self.bank_b


@dataclass(frozen=True, slots=True)
class ExchangeLayout:
    """0-based addresses of one loop's exchange registers, all of them holding registers.

    ``ack_refusal`` and ``writer`` are optional: without them no refusal is reported, and a second
    writer with an identity of its own not be seen.
    """

    enable: int
    ack_seq: int
    ack_result: int
    active_bank: int
    ack_commit: int
    heartbeat: int
    commit: int
    bank_a: int
    bank_b: int
    ack_refusal: int | None = None
    writer: int | None = None

    def __post_init__(self) -> None:
        taken: dict[int, str] = {}
        for name, first, last in self.spans():
            if first < 0 or last > 0xFFFF:
                raise ValueError(f"{name}: {first} to {last} is outside 0 to 65535")
            for address in range(first, last + 1):
                if address in taken:
                    raise ValueError(f"{name} and {taken[address]} share register {address}")
                taken[address] = name

    @classmethod
    def at(cls, base: int) -> ExchangeLayout:
        """Return the compact layout: PLC's words, Fieldlink's words, the two banks."""
        return cls(
            enable=base,
            ack_seq=base + 1,
            ack_result=base + 2,
            active_bank=base + 3,
            ack_commit=base + 4,
            heartbeat=base + 6,
            commit=base + 7,
            bank_a=base + _BANK_A_OFFSET,
            bank_b=base + _BANK_B_OFFSET,
            ack_refusal=base + 5,
            writer=base + 8,
        )

    def bank_address(self, bank: Bank) -> int:
        """Return the address of a bank's first register."""
        return self.bank_a if bank is Bank.A else self.bank_b

    def spans(self) -> tuple[tuple[str, int, int], ...]:
        """Return (name, first address, last address) of every part, in the order of the fields,
        without the registers that the site leaves out.
        """
        return tuple(
            (part.name, first, first + (BLOCK_REGISTERS if part.name.startswith("bank") else 1) - 1)
            for part in fields(self)
            for first in (getattr(self, part.name),)
            if first is not None
        )

    def view(self, read: Callable[[int, int], Sequence[int]]) -> ExchangeWords:
        """Return what a PLC task reads of the area; ``read(address, count)`` gives registers."""
        return ExchangeWords(
            enable=read(self.enable, 1)[0],
            heartbeat=read(self.heartbeat, 1)[0],
            commit=read(self.commit, 1)[0],
            bank_a=tuple(read(self.bank_a, BLOCK_REGISTERS)),
            bank_b=tuple(read(self.bank_b, BLOCK_REGISTERS)),
        )
