"""Which register of a parameter block holds what: the single source of code and documentation.

32-bit fields begin at even offsets and 64-bit fields at multiples of four, so that a PLC can
overlay them where its compiler wants such alignment.

The coefficients a and b are double precision and the rest is single. A third-order process sampled
a hundred times faster than its lags has A(1) = 1 + a1 + a2 + a3 near 1e-6; rounding coefficients to
single precision (1e-7) makes it another process. A PLC without LREAL takes gain, time constant and
dead time instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fieldlink.registers.types import DataType, Order
from fieldlink.registers.words import decode, encode

__all__ = [
    "BLOCK_FIELDS",
    "BLOCK_REGISTERS",
    "LAYOUT_VERSION",
    "MAGIC",
    "MAX_COEFFICIENTS",
    "BlockField",
    "pack",
    "unpack",
]

MAGIC = 0x464C
"""``"FL"``: the first register of every block."""

LAYOUT_VERSION = 1

MAX_COEFFICIENTS = 4
"""The block has room for a1..a4 and b1..b4."""


@dataclass(frozen=True, slots=True)
class BlockField:
    """One field of the block: ``offset`` in registers from its start."""

    name: str
    offset: int
    data_type: DataType
    unit: str
    text: str

    @property
    def end(self) -> int:
        """The first offset after the field."""
        return self.offset + self.data_type.registers


_Row = tuple[str, DataType, str, str]


def _bounded(name: str, text: str) -> list[_Row]:
    kind = DataType.FLOAT32
    return [
        (name, kind, "OP", text),
        (f"{name}_low", kind, "OP", "its lower bound"),
        (f"{name}_high", kind, "OP", "its upper bound"),
    ]


_WORD, _LONG = DataType.UINT16, DataType.UINT32
_REAL, _LREAL = DataType.FLOAT32, DataType.FLOAT64

_ROWS: list[_Row] = [
    ("magic", _WORD, "", f"always 16#{MAGIC:04X} ('FL')"),
    ("version", _WORD, "", f"layout version, {LAYOUT_VERSION}"),
    ("loop_id", _WORD, "", "the loop the block is for, 1 to 65535"),
    ("seq", _WORD, "", "sequence number, 1 to 65535, never 0; after 65535 comes 1"),
    ("status", _WORD, "", "0 invalid, 1 valid, 2 no stiction, 3 not assessable, 4 withdrawn"),
    ("length", _WORD, "", "registers in the whole block"),
    ("valid_for", _LONG, "s", "seconds from acceptance after which the block expires"),
    ("window_end", DataType.UINT64, "ms", "end of the window, UTC, milliseconds since 1970-01-01"),
    *_bounded("static_friction", "fS = (S + J) / 2"),
    *_bounded("dynamic_friction", "fD = (S - J) / 2"),
    *_bounded("stick_band", "S = fS + fD"),
    *_bounded("slip_jump", "J = fS - fD"),
    ("confidence", _REAL, "", "of the bounds above, 0.9 for 90 %"),
    ("smoothing", _REAL, "1/OP", "tau of the smoothed valve model; 0 when not used"),
    ("period", _REAL, "s", "sampling period of the process model"),
    ("dead_time", _WORD, "samples", "from stem to PV; 0 is direct feed-through"),
    ("na", _WORD, "", "how many of a1..a4 are used"),
    ("nb", _WORD, "", "how many of b1..b4 are used; 0 when the block has no process model"),
    ("process_kind", _WORD, "", "0 no process model, 1 self-regulating, 2 integrating"),
    ("offset", _REAL, "PV", "constant term of the recursion below"),
    ("gain", _REAL, "PV/OP", "steady-state gain; PV per OP and second when integrating"),
    ("time_constant", _REAL, "s", "of the slowest pole that is not an integrator; 0 when none"),
    *[
        (f"a{i}", _LREAL, "", "y(k) = -a1 y(k-1) - ..." if i == 1 else "")
        for i in range(1, MAX_COEFFICIENTS + 1)
    ],
    *[
        (
            f"b{i}",
            _LREAL,
            "PV/OP",
            "... + b1 x(k-d) + b2 x(k-d-1) + ... + offset; x stem, d dead time" if i == 1 else "",
        )
        for i in range(1, MAX_COEFFICIENTS + 1)
    ],
    ("verdict", _WORD, "", "0 none, 1 stiction, 2 no stiction, 3 not assessable"),
    ("windows", _WORD, "", "windows in agreement"),
    ("samples", _LONG, "", "samples used"),
    ("fit", _REAL, "", "share of PV's variance explained (R squared)"),
    ("evidence", _REAL, "", "log-likelihood ratio for a sticky against a healthy valve"),
    ("crc", _WORD, "", "CRC-16/MODBUS of all registers before it, high byte first"),
    ("seq_again", _WORD, "", "seq once more"),
]


def _lay_out(rows: Sequence[_Row]) -> tuple[BlockField, ...]:
    fields = []
    offset = 0
    for name, data_type, unit, text in rows:
        fields.append(BlockField(name, offset, data_type, unit, text))
        offset += data_type.registers
    return tuple(fields)


BLOCK_FIELDS = _lay_out(_ROWS)
"""The fields of a block in the order of their registers, without holes."""

BLOCK_REGISTERS = BLOCK_FIELDS[-1].end
"""Registers in a block; one FC16 request may write 123."""


def pack(values: Mapping[str, float], word_order: Order) -> list[int]:
    """Return the registers of the given field values (a value for every field)."""
    words: list[int] = []
    for field in BLOCK_FIELDS:
        words.extend(encode(values[field.name], field.data_type, word_order=word_order))
    return words


def unpack(words: Sequence[int], word_order: Order) -> dict[str, float]:
    """Return every field's value of a block's registers, unchecked."""
    return {
        field.name: decode(words[field.offset : field.end], field.data_type, word_order=word_order)
        for field in BLOCK_FIELDS
    }
