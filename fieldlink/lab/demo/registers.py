"""The active parameter block, read over the wire as any client would, field by field."""

from __future__ import annotations

from dataclasses import dataclass

from fieldlink.links import RegisterAccess, open_link
from fieldlink.registers import BLOCK_FIELDS, BLOCK_REGISTERS, Bank, decode
from fieldlink.site import Site

__all__ = ["RegisterRow", "read_block"]


@dataclass(frozen=True, slots=True)
class RegisterRow:
    """One field of a block: its first holding register (0-based), its name, value and unit."""

    address: int
    name: str
    value: float
    unit: str


async def read_block(site: Site, device: str, loop: str) -> tuple[RegisterRow, ...]:
    """Read the active bank of a loop.

    Raises:
        LinkError: the device does not answer.
    """
    layout = site.loops[loop].writeback.exchange
    assert layout is not None
    link = open_link(site, device)
    assert isinstance(link, RegisterAccess)
    await link.open()
    try:
        (active,) = await link.read_registers(layout.active_bank, 1)
        start = layout.bank_a if Bank(active) is Bank.A else layout.bank_b
        words = await link.read_registers(start, BLOCK_REGISTERS)
    finally:
        await link.close()
    order = site.devices[device].word_order
    return tuple(
        RegisterRow(
            start + field.offset,
            field.name,
            float(decode(words[field.offset : field.end], field.data_type, word_order=order)),
            field.unit,
        )
        for field in BLOCK_FIELDS
    )
