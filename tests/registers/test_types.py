"""Register types against pymodbus and `struct`, which know nothing of this code."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin

from fieldlink.registers import DataType, RegisterValueError, decode, encode
from fieldlink.registers.types import Order, order_name

NUMBERS = [data_type for data_type in DataType if data_type.is_number]
BINARY = [data_type for data_type in NUMBERS if not data_type.is_bcd]
ORDERS: list[Order] = ["big", "little"]


def words_of(data_type: DataType) -> st.SearchStrategy[list[int]]:
    count = data_type.registers
    return st.lists(st.integers(0, 0xFFFF), min_size=count, max_size=count)


@pytest.mark.parametrize("word_order", ORDERS)
@pytest.mark.parametrize("data_type", BINARY)
@given(data=st.data())
def test_decoding_agrees_with_pymodbus(
    data_type: DataType, word_order: Order, data: st.DataObject
) -> None:
    words = data.draw(words_of(data_type))
    theirs = ModbusClientMixin.convert_from_registers(
        words, ModbusClientMixin.DATATYPE[data_type.name], word_order
    )
    ours = decode(words, data_type, word_order=word_order)
    assert ours == theirs or (math.isnan(ours) and math.isnan(float(str(theirs))))


@pytest.mark.parametrize("byte_order", ORDERS)
@pytest.mark.parametrize("word_order", ORDERS)
@pytest.mark.parametrize("data_type", BINARY)
@settings(max_examples=40)  # of each of 32 types and orders
@given(data=st.data())
def test_encoding_undoes_decoding(
    data_type: DataType, word_order: Order, byte_order: Order, data: st.DataObject
) -> None:
    words = data.draw(words_of(data_type))
    value = decode(words, data_type, word_order=word_order, byte_order=byte_order)
    if math.isnan(value):  # a NaN has many bit patterns
        return
    assert encode(value, data_type, word_order=word_order, byte_order=byte_order) == words


@pytest.mark.parametrize(
    ("word_order", "byte_order", "name", "wire"),
    [
        ("big", "big", "ABCD", bytes([0xAA, 0xBB, 0xCC, 0xDD])),
        ("little", "big", "CDAB", bytes([0xCC, 0xDD, 0xAA, 0xBB])),
        ("big", "little", "BADC", bytes([0xBB, 0xAA, 0xDD, 0xCC])),
        ("little", "little", "DCBA", bytes([0xDD, 0xCC, 0xBB, 0xAA])),
    ],
)
def test_the_four_orders_have_the_names_of_device_manuals(
    word_order: Order, byte_order: Order, name: str, wire: bytes
) -> None:
    assert order_name(word_order, byte_order) == name
    words = list(struct.unpack(">2H", wire))
    order = {"word_order": word_order, "byte_order": byte_order}
    assert decode(words, DataType.UINT32, **order) == 0xAABBCCDD
    assert encode(0xAABBCCDD, DataType.UINT32, **order) == words


def test_a_float64_is_struct_s_big_endian_double() -> None:
    words = list(struct.unpack(">4H", struct.pack(">d", math.pi)))
    assert decode(words, DataType.FLOAT64) == math.pi
    assert encode(math.pi, DataType.FLOAT64) == words


@pytest.mark.parametrize(("word", "truth"), [(0, False), (1, True), (0x0100, True), (0xFFFF, True)])
def test_any_non_zero_register_is_true(word: int, truth: bool) -> None:
    assert decode([word], DataType.BOOL) is truth


@pytest.mark.parametrize("data_type", [DataType.FLOAT32, DataType.FLOAT64])
def test_nan_travels_in_float_registers(data_type: DataType) -> None:
    assert math.isnan(decode(encode(math.nan, data_type), data_type))


@pytest.mark.parametrize(
    ("value", "data_type", "limit"),
    [
        (32768, DataType.INT16, "-32768 to 32767"),
        (-1, DataType.UINT16, "0 to 65535"),
        (2**32, DataType.UINT32, "4294967295"),
        (2**63, DataType.INT64, "9223372036854775807"),
        (1e39, DataType.FLOAT32, "3.40282e+38"),
        (math.nan, DataType.INT32, "float type"),
        (2, DataType.BOOL, "0 or 1"),
    ],
)
def test_what_does_not_fit_is_refused_with_the_limit(
    value: float, data_type: DataType, limit: str
) -> None:
    with pytest.raises(RegisterValueError, match=limit.replace("+", r"\+")):
        encode(value, data_type)


def test_integers_round_to_the_nearest() -> None:
    assert encode(99.6, DataType.UINT16) == [100]
    assert encode(-0.4, DataType.UINT16) == [0]


def test_words_that_make_no_value_are_refused() -> None:
    with pytest.raises(RegisterValueError, match="takes 2"):
        decode([1], DataType.FLOAT32)
    with pytest.raises(RegisterValueError, match="65536"):
        decode([65536], DataType.UINT16)
