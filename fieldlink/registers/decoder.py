"""All tags of a reply at once: the fields of a block are laid out when the plan is made.

`Tag.decode` says what a tag's registers mean; this does the same for a whole request with a handful
of `struct` calls, because a daemon decodes every reply of every scan. What is not a plain number (a
bit, BCD, text, a tag with declared invalid values or a clamp) is finished by the tag itself.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fieldlink.registers.plan import ReadRequest
from fieldlink.registers.tag import Tag, ValueQuality
from fieldlink.registers.types import DataType, Order, Table

__all__ = ["BlockDecoder", "Decoded", "pack_payload", "unpack_payload"]

Decoded = tuple[str, float, ValueQuality, str | None]
"""Tag name, value in engineering units, quality, and the text of a string."""

_INFINITE = float("inf")


@dataclass(frozen=True, slots=True)
class _Layer:
    """Tags of one order that do not overlap, in the order in which ``layout`` unpacks them."""

    word_order: Order
    byte_order: Order
    layout: struct.Struct
    names: tuple[str, ...]
    scales: tuple[tuple[float, float, float, float], ...]


def pack_payload(table: Table, values: Sequence[int]) -> bytes:
    """Return the registers, or bits, of ``table`` as a reply carries them."""
    if not table.is_bits:
        return struct.pack(f">{len(values)}H", *values)
    return bytes(
        sum(bool(bit) << k for k, bit in enumerate(values[i : i + 8]))
        for i in range(0, len(values), 8)
    )


def unpack_payload(table: Table, payload: bytes, count: int) -> list[int]:
    """Return the ``count`` registers, or bits as 0 and 1, that a reply carries."""
    if table.is_bits:
        return [payload[i // 8] >> i % 8 & 1 for i in range(count)]
    return list(struct.unpack(f">{count}H", payload))


class BlockDecoder:
    """Decodes replies to one read request.

    Args:
        request: the read request.
    """

    def __init__(self, request: ReadRequest) -> None:
        self._request = request
        plain = [tag for tag in request.tags if _is_plain(tag)]
        self._others = tuple(tag for tag in request.tags if not _is_plain(tag))
        self._layers = tuple(_layers(plain, request))

    def decode(self, payload: bytes) -> list[Decoded]:
        """Return what ``payload`` holds: two bytes a register or eight bits a byte, as on the wire.

        Raises:
            struct.error: ``payload`` is not as long as the request asks for.
        """
        if self._request.table.is_bits:
            return [self._bit(tag, payload) for tag in self._request.tags]
        found: list[Decoded] = []
        good = ValueQuality.GOOD
        for layer in self._layers:
            ordered = _reorder(payload, layer.word_order, layer.byte_order)
            values = layer.layout.unpack(ordered)
            for name, (scale, offset, low, high), raw in zip(
                layer.names, layer.scales, values, strict=True
            ):
                value = scale * raw + offset
                if low <= value <= high:
                    quality = good
                elif value < low and value != -_INFINITE:
                    quality = ValueQuality.BELOW_RANGE
                elif value > high and value != _INFINITE:
                    quality = ValueQuality.ABOVE_RANGE
                else:
                    quality = ValueQuality.NOT_A_NUMBER
                found.append((name, value, quality, None))
        if self._others:
            words = struct.unpack(f">{self._request.count}H", payload)
            for tag in self._others:
                reading = tag.decode(self._request.words_of(tag, words))
                found.append((tag.name, reading.value, reading.quality, reading.text))
        return found

    def _bit(self, tag: Tag, payload: bytes) -> Decoded:
        place = tag.address - self._request.address
        reading = tag.judge(float(payload[place // 8] >> place % 8 & 1))
        return tag.name, reading.value, reading.quality, None


def _is_plain(tag: Tag) -> bool:
    return not (
        tag.clamp
        or tag.invalid
        or tag.invalid_patterns
        or tag.data_type.is_bcd
        or tag.data_type in (DataType.STRING, DataType.BOOL)
    )


def _layers(tags: Sequence[Tag], request: ReadRequest) -> Iterator[_Layer]:
    for order in dict.fromkeys((tag.word_order, tag.byte_order) for tag in tags):
        waiting = [tag for tag in tags if (tag.word_order, tag.byte_order) == order]
        mirrored = order[0] == "little"
        places = [
            (request.end - tag.end if mirrored else tag.address - request.address, tag)
            for tag in waiting
        ]
        places.sort(key=lambda place: place[0])
        while places:
            layer, places = _one_layer(places)
            yield _layer(layer, request.count, *order)


def _one_layer(
    places: list[tuple[int, Tag]],
) -> tuple[list[tuple[int, Tag]], list[tuple[int, Tag]]]:
    """Take the tags that lie one behind another; views of the same registers have to wait."""
    taken, left, end = [], [], 0
    for place, tag in places:
        if place >= end:
            taken.append((place, tag))
            end = place + tag.count
        else:
            left.append((place, tag))
    return taken, left


def _layer(
    places: Sequence[tuple[int, Tag]], count: int, word_order: Order, byte_order: Order
) -> _Layer:
    formats, end = [">"], 0
    for place, tag in places:
        formats.append(f"{2 * (place - end)}x{tag.data_type.format_code}")
        end = place + tag.count
    formats.append(f"{2 * (count - end)}x")
    return _Layer(
        word_order,
        byte_order,
        struct.Struct("".join(formats)),
        tuple(tag.name for _, tag in places),
        tuple(_scale(tag) for _, tag in places),
    )


def _scale(tag: Tag) -> tuple[float, float, float, float]:
    low = -1.7976931348623157e308 if tag.low is None else tag.low
    high = 1.7976931348623157e308 if tag.high is None else tag.high
    return tag.scale, tag.offset, low, high


def _reorder(payload: bytes, word_order: Order, byte_order: Order) -> bytes:
    """Return the words as a big-endian device would have sent them, mirrored for "little"."""
    if word_order == "big" and byte_order == "big":
        return payload
    words = array("H", payload)
    if byte_order == "little":
        words.byteswap()
    if word_order == "little":
        words.reverse()
    return words.tobytes()
