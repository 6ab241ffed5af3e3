from __future__ import annotations

import math

import pytest

from fieldlink.registers import DataType, RegisterValueError, Table, Tag, ValueQuality, encode

PERCENT = Tag(
    "FC101.OP", Table.HOLDING, 0, DataType.INT16, scale=0.01, unit="%", low=0.0, high=100.0
)
FLOW = Tag("FC101.PV", Table.INPUT, 2, DataType.FLOAT32, low=0.0)


def test_engineering_value_is_scale_times_raw_plus_offset() -> None:
    tag = Tag("TI1", Table.HOLDING, 0, DataType.UINT16, scale=0.1, offset=-40.0)
    assert tag.decode([650]).value == pytest.approx(25.0)
    assert tag.encode(25.0) == [650]


@pytest.mark.parametrize(
    ("raw", "quality"),
    [
        (0, ValueQuality.GOOD),
        (10000, ValueQuality.GOOD),
        (10001, ValueQuality.ABOVE_RANGE),
        (0xFFFF, ValueQuality.BELOW_RANGE),  # -1 as int16
    ],
)
def test_the_engineering_range_gives_the_quality(raw: int, quality: ValueQuality) -> None:
    assert PERCENT.decode([raw]).quality is quality


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_number_is_marked(value: float) -> None:
    assert FLOW.decode(encode(value, DataType.FLOAT32)).quality is ValueQuality.NOT_A_NUMBER


def test_writing_outside_the_range_is_refused_with_the_limits() -> None:
    with pytest.raises(RegisterValueError, match=r"FC101\.OP: 101 is above .*0\.0 to 100\.0 %"):
        PERCENT.encode(101.0)


def test_clamping_saturates_at_the_type_as_a_transmitter_does() -> None:
    assert PERCENT.encode(400.0, clamp=True) == [32767]
    assert PERCENT.encode(101.0, clamp=True) == [10100]


def test_the_orders_of_the_device_are_used() -> None:
    tag = Tag("X", Table.HOLDING, 0, DataType.UINT32, word_order="little", byte_order="little")
    assert tag.encode(0x01020304) == [0x0403, 0x0201]
    assert tag.decode([0x0403, 0x0201]).value == 0x01020304


def test_an_integer_tag_cannot_hold_nan() -> None:
    with pytest.raises(RegisterValueError, match=r"FC101\.OP: nan"):
        PERCENT.encode(math.nan)


@pytest.mark.parametrize("scale", [1.0, -1.0, 0.3])
@pytest.mark.parametrize("value", [20.5, 20.7, 50.4, 80.4, 80.5])
def test_a_value_is_rounded_to_a_count_inside_its_limits(scale: float, value: float) -> None:
    tag = Tag("OUT", Table.HOLDING, 0, DataType.INT16, scale=scale)
    held = tag.decode(tag.encode_inside(value, 20.5, 80.5)).value
    assert 20.5 <= held <= 80.5
    assert abs(held - value) <= abs(scale)


def test_round_limits_are_counts_and_limits_between_two_counts_are_refused() -> None:
    tag = Tag("OUT", Table.HOLDING, 0, DataType.UINT16, scale=0.1)
    assert tag.encode_inside(80.3, 0.0, 80.3) == [803]
    assert tag.encode_inside(0.3, 0.3, 80.3) == [3]
    with pytest.raises(RegisterValueError, match=r"none of its counts of 0\.1 lies in 80\.32 to"):
        tag.encode_inside(80.34, 80.32, 80.38)
