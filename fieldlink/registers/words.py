"""Values in 16-bit words: numbers by `decode` and `encode`, text by `decode_text`, `encode_text`.

`types` has the kinds of value and explains the orders of words and bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from fieldlink.registers.types import CODECS, Codec, DataType, Order, RegisterValueError

__all__ = ["decode", "decode_text", "encode", "encode_text", "pattern"]

# Words of registers from the bytes of a number, by byte order and count.
_REGISTERS: dict[Order, dict[int, struct.Struct]] = {
    "big": {count: struct.Struct(f">{count}H") for count in (1, 2, 4)},
    "little": {count: struct.Struct(f"<{count}H") for count in (1, 2, 4)},
}


def decode(
    words: Sequence[int],
    data_type: DataType,
    *,
    word_order: Order = "big",
    byte_order: Order = "big",
) -> int | float | bool:
    """Return the raw value that ``words`` (exactly ``data_type.registers`` of them) hold.

    Any non-zero register is a true ``bool``. Floats may come out as NaN or infinite, and BCD with a
    digit above 9 comes out as NaN.

    Raises:
        RegisterValueError: the number of words is not the type's, a word is not 0..65535, or the
            type is a string (see `decode_text`).
    """
    codec = _number_codec(data_type)
    if len(words) != codec.registers:
        raise RegisterValueError(
            f"{data_type} takes {codec.registers} register(s), got {len(words)}"
        )
    if data_type is DataType.BOOL:
        return _as_words(words, "big", "big")[0] != 0
    registers = _REGISTERS[byte_order][codec.registers]
    try:
        packed = registers.pack(*(words if word_order == "big" else words[::-1]))
    except struct.error:
        _require_words(words)
        raise
    value: int | float = codec.number.unpack(packed)[0]
    return _from_bcd(int(value)) if codec.is_bcd else value


def encode(
    value: float | bool,
    data_type: DataType,
    *,
    word_order: Order = "big",
    byte_order: Order = "big",
) -> list[int]:
    """Return the words that hold ``value``; integer types round to the nearest, ties to even.

    NaN and infinities go into the float types as they are.

    Raises:
        RegisterValueError: the type cannot hold the value.
    """
    codec = _number_codec(data_type)
    if data_type is DataType.BOOL:
        if value not in (0, 1):
            raise RegisterValueError(f"{value!r} is not a bool; write 0 or 1")
        return [int(value)]
    if codec.is_float:
        if math.isfinite(value) and not codec.low <= value <= codec.high:
            raise RegisterValueError(f"{value!r} does not fit {data_type} (at most {codec.high:g})")
        packed = codec.number.pack(value)
    else:
        if not math.isfinite(value):
            raise RegisterValueError(f"{value!r} does not fit {data_type}; use a float type")
        whole = round(value)
        if not codec.low <= whole <= codec.high:
            raise RegisterValueError(
                f"{value!r} does not fit {data_type} ({codec.low} to {codec.high})"
            )
        packed = codec.number.pack(int(str(whole), 16) if codec.is_bcd else whole)
    words = list(_REGISTERS[byte_order][codec.registers].unpack(packed))
    if word_order == "little":
        words.reverse()
    return words


def decode_text(words: Sequence[int], *, byte_order: Order = "big") -> str:
    """Return the text in ``words``, two characters a register, up to the first zero.

    What is not ASCII comes out as U+FFFD; blanks at the end are left out.

    Raises:
        RegisterValueError: a word is not 0..65535.
    """
    ordered = _as_words(words, "big", byte_order)
    raw = struct.pack(f">{len(ordered)}H", *ordered)
    return raw.split(b"\0", 1)[0].decode("ascii", errors="replace").rstrip()


def encode_text(text: str, registers: int, *, byte_order: Order = "big") -> list[int]:
    """Return ``registers`` words that hold ``text``, filled up with zeros.

    Raises:
        RegisterValueError: the text is too long or not ASCII.
    """
    try:
        raw = text.encode("ascii")
    except UnicodeEncodeError as error:
        raise RegisterValueError(
            f"{text!r} is not ASCII; leave out {error.object[error.start]!r}"
        ) from error
    if len(raw) > 2 * registers:
        raise RegisterValueError(
            f"{text!r} has {len(raw)} characters, {registers} register(s) hold {2 * registers}"
        )
    words = struct.unpack(f">{registers}H", raw.ljust(2 * registers, b"\0"))
    return _as_words(words, "big", byte_order)


def pattern(words: Sequence[int], *, word_order: Order = "big", byte_order: Order = "big") -> int:
    """Return the bits of ``words`` as one unsigned number, as manuals write them: 0x8000."""
    number = 0
    for word in _as_words(words, word_order, byte_order):
        number = number << 16 | word
    return number


def _number_codec(data_type: DataType) -> Codec:
    if data_type is DataType.STRING:
        raise RegisterValueError("a string is not a number; use decode_text and encode_text")
    return CODECS[data_type]


def _from_bcd(word: int) -> int | float:
    """Return the decimal number whose digits are the hexadecimal ones; NaN when one is above 9."""
    digits = f"{word:x}"
    return int(digits) if digits.isdecimal() else math.nan


def _require_words(words: Sequence[int]) -> None:
    for word in words:
        if not 0 <= word <= 0xFFFF:
            raise RegisterValueError(f"{word!r} is not a register value (0 to 65535)")


def _as_words(words: Sequence[int], word_order: Order, byte_order: Order) -> list[int]:
    """Reorder between device order and big-endian order; the mapping is its own inverse."""
    _require_words(words)
    ordered = list(words) if word_order == "big" else list(reversed(words))
    if byte_order == "little":
        ordered = [(word >> 8) | ((word & 0xFF) << 8) for word in ordered]
    return ordered
