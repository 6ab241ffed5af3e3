"""Bits, BCD, text, two points, invalid values and clamping, and whole replies at once."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldlink.registers import (
    ORDERS,
    BlockDecoder,
    DataType,
    ReadRequest,
    RegisterValueError,
    Table,
    Tag,
    ValueQuality,
    decode,
    decode_text,
    encode,
    encode_text,
    pack_payload,
    plan_reads,
    unpack_payload,
)

NAN32 = struct.unpack(">2H", struct.pack(">f", math.nan))


def tag(kind: DataType, address: int = 0, **rest: Any) -> Tag:
    return Tag(f"T{address}", Table.HOLDING, address, kind, **rest)


@pytest.mark.parametrize(
    ("words", "kind", "value"),
    [
        ([0x1234], DataType.BCD16, 1234),
        ([0x0000], DataType.BCD16, 0),
        ([0x9999], DataType.BCD16, 9999),
        ([0x1234, 0x5678], DataType.BCD32, 12345678),
    ],
)
def test_bcd_is_read_digit_by_digit(words: list[int], kind: DataType, value: int) -> None:
    assert decode(words, kind) == value
    assert encode(value, kind) == words


def test_bcd_in_the_four_orders() -> None:
    wire = {
        "ABCD": [0x1234, 0x5678],
        "CDAB": [0x5678, 0x1234],
        "BADC": [0x3412, 0x7856],
        "DCBA": [0x7856, 0x3412],
    }
    for name, (word_order, byte_order) in ORDERS.items():
        found = tag(DataType.BCD32, word_order=word_order, byte_order=byte_order)
        assert found.decode(wire[name]).value == 12345678


@pytest.mark.parametrize(
    ("kind", "modulus"),
    [
        (DataType.UINT16, 2.0**16),
        (DataType.INT16, 2.0**16),
        (DataType.UINT32, 2.0**32),
        (DataType.BCD16, 1e4),
        (DataType.BOOL, 2.0),
        (DataType.FLOAT32, math.inf),
    ],
)
def test_where_a_counter_wraps(kind: DataType, modulus: float) -> None:
    assert kind.modulus == modulus


def test_a_digit_above_nine_is_no_number() -> None:
    assert tag(DataType.BCD16).decode([0x12A4]).quality is ValueQuality.NOT_A_NUMBER


@pytest.mark.parametrize("value", [-1, 10_000])
def test_bcd_holds_four_digits(value: int) -> None:
    with pytest.raises(RegisterValueError, match="0 to 9999"):
        encode(value, DataType.BCD16)


@pytest.mark.parametrize("bit", [0, 3, 15])
def test_one_bit_of_a_register(bit: int) -> None:
    found = tag(DataType.BOOL, bit=bit)
    assert found.decode([1 << bit]).value == 1.0
    assert found.decode([0xFFFF ^ 1 << bit]).value == 0.0


def test_a_bit_is_counted_in_the_devices_byte_order() -> None:
    assert tag(DataType.BOOL, bit=0, byte_order="little").decode([0x0100]).value == 1.0


def test_a_bit_is_set_among_its_neighbours() -> None:
    assert tag(DataType.BOOL, bit=2).with_bit(0x8001, True) == 0x8005
    assert tag(DataType.BOOL, bit=0).with_bit(0x8001, False) == 0x8000
    assert tag(DataType.BOOL, bit=0, byte_order="little").with_bit(0, True) == 0x0100


def test_a_bit_is_never_written() -> None:
    with pytest.raises(RegisterValueError, match="one bit of a register"):
        tag(DataType.BOOL, bit=2).encode(1.0)


def test_text_ends_at_the_first_zero() -> None:
    words = struct.unpack(">4H", b"FC101\0xy")
    assert decode_text(words) == "FC101"
    swapped = [(word >> 8) | (word & 0xFF) << 8 for word in words]
    assert decode_text(swapped, byte_order="little") == "FC101"
    assert tag(DataType.STRING, length=4).decode(words).text == "FC101"


@given(st.text(st.characters(codec="ascii", min_codepoint=33), max_size=10))
def test_text_comes_back(text: str) -> None:
    for byte_order in ("big", "little"):
        words = encode_text(text, 5, byte_order=byte_order)  # type: ignore[arg-type]
        assert decode_text(words, byte_order=byte_order) == text  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["too long", "Ü"])
def test_text_that_does_not_fit_is_refused(text: str) -> None:
    with pytest.raises(RegisterValueError, match=text):
        encode_text(text, 2)


@pytest.mark.parametrize(
    ("kind", "words", "rest"),
    [
        (DataType.INT16, [0x8000], {"invalid_patterns": (0x8000,)}),
        (DataType.UINT16, [0xFFFF], {"invalid_patterns": (0xFFFF,)}),
        (DataType.INT16, [0x8000], {"invalid": (-32768.0,)}),
        (DataType.FLOAT32, [0xC61C, 0x3C00], {"invalid": (-9999.0,), "scale": 0.1}),
        (DataType.UINT32, [0xFFFF, 0xFFFF], {"invalid_patterns": (0xFFFFFFFF,)}),
        (
            DataType.UINT32,
            [0x0000, 0x8000],
            {"invalid_patterns": (0x80000000,), "word_order": "little"},
        ),
    ],
)
def test_what_the_map_calls_invalid_is_invalid(
    kind: DataType, words: list[int], rest: dict[str, Any]
) -> None:
    assert tag(kind, **rest).decode(words).quality is ValueQuality.INVALID
    assert tag(kind).decode(words).quality is ValueQuality.GOOD


def test_nan_is_never_good_even_where_it_would_be_clamped() -> None:
    found = tag(DataType.FLOAT32, low=0.0, high=1.0, clamp=True)
    assert found.decode(NAN32).quality is ValueQuality.NOT_A_NUMBER


@pytest.mark.parametrize(("raw", "value"), [(150, 100.0), (50, 50.0), (0, 10.0)])
def test_clamping_cuts_a_reading_off_at_its_range(raw: int, value: float) -> None:
    reading = tag(DataType.INT16, low=10.0, high=100.0, clamp=True).decode([raw])
    assert (reading.value, reading.quality) == (value, ValueQuality.GOOD)


@st.composite
def requests(draw: st.DrawFn) -> ReadRequest:
    """A read of tags of every kind, some of them views of the same registers."""
    tags = []
    for number in range(draw(st.integers(1, 12))):
        kind = draw(st.sampled_from(list(DataType)))
        word_order, byte_order = draw(st.sampled_from(list(ORDERS.values())))
        ranged = kind.is_number and draw(st.booleans())
        tags.append(
            Tag(
                f"T{number}",
                Table.HOLDING,
                draw(st.integers(100, 130)),
                kind,
                scale=draw(st.sampled_from([1.0, 0.1, -2.0])),
                offset=draw(st.sampled_from([0.0, 5.0])),
                low=-10.0 if ranged else None,
                high=1000.0 if ranged else None,
                clamp=ranged and draw(st.booleans()),
                word_order=word_order,
                byte_order=byte_order,
                bit=draw(st.none() | st.integers(0, 15)) if kind is DataType.BOOL else None,
                length=draw(st.integers(1, 6)) if kind is DataType.STRING else 0,
                invalid=(0.0,) if kind.is_number and draw(st.booleans()) else (),
                invalid_patterns=(0xFFFF,) if kind.is_number and draw(st.booleans()) else (),
            )
        )
    start, end = min(tag.address for tag in tags), max(tag.end for tag in tags)
    return ReadRequest(Table.HOLDING, start, end - start, tuple(tags))


@given(requests(), st.data())
def test_a_whole_reply_is_decoded_as_its_tags_are(
    request: ReadRequest, data: st.DataObject
) -> None:
    word = st.sampled_from([0, 1, 0x8000, 0xFFFF, 0x7FC0, 0x4142]) | st.integers(0, 0xFFFF)
    words = data.draw(st.lists(word, min_size=request.count, max_size=request.count))
    found = {
        name: (value, quality, text)
        for name, value, quality, text in BlockDecoder(request).decode(
            pack_payload(Table.HOLDING, words)
        )
    }
    assert len(found) == len(request.tags)
    for tag in request.tags:
        alone = tag.decode(request.words_of(tag, words))
        value, quality, text = found[tag.name]
        assert (quality, text) == (alone.quality, alone.text)
        assert value == alone.value or (math.isnan(value) and math.isnan(alone.value))


@given(st.lists(st.integers(0, 1), min_size=1, max_size=40))
def test_bits_are_packed_as_the_protocol_says(bits: list[int]) -> None:
    payload = pack_payload(Table.COIL, bits)
    assert len(payload) == -(-len(bits) // 8)
    assert payload[0] & 1 == bits[0]
    assert unpack_payload(Table.COIL, payload, len(bits)) == bits
    tags = tuple(Tag(f"C{i}", Table.COIL, 20 + i, DataType.BOOL) for i in range(len(bits)))
    request = ReadRequest(Table.COIL, 20, len(bits), tags)
    assert [value for _, value, _, _ in BlockDecoder(request).decode(payload)] == bits


def test_tags_of_different_rates_never_share_a_request() -> None:
    fast = [tag(DataType.UINT16, n) for n in (0, 2)]
    slow = [tag(DataType.UINT16, n, every=10.0) for n in (1, 3)]
    found = plan_reads([*fast, *slow])
    assert [(request.every, request.address, request.count) for request in found] == [
        (0.0, 0, 3),
        (10.0, 1, 3),
    ]


def test_one_tag_a_request_splits_even_what_belongs_together() -> None:
    tags = [tag(DataType.UINT16, n) for n in (0, 1)]
    found = plan_reads(tags, together=[("T0", "T1")], one_tag=True)
    assert [request.address for request in found] == [0, 1]
