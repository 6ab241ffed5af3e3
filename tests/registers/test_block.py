from __future__ import annotations

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.framer.rtu import FramerRTU

from fieldlink.registers import (
    ACCEPTED,
    BLOCK_FIELDS,
    BLOCK_REGISTERS,
    NOTHING_SEEN,
    BlockError,
    BlockFault,
    Bounded,
    ParameterBlock,
    Status,
    Verdict,
    decode_block,
    describe_ack,
    encode_block,
    is_newer,
    next_seq,
)
from fieldlink.registers.crc import crc16
from fieldlink.registers.types import Order
from loop_model import LoopModel, ProcessModel, ValveModel

# Example 1 of the paper, equation (15).
PROCESS = ProcessModel(
    a=(-2.2318, 1.6450, -0.39985),
    b=(0.00277, 0.00884, 0.00175),
    dead_time=1,
    offset=0.5,
    period=0.1,
)
MODEL = LoopModel(ValveModel(stick_band=11.0, slip_jump=3.0), PROCESS)
BLOCK = ParameterBlock.from_model(
    MODEL,
    loop_id=101,
    seq=7,
    valid_for=86400,
    window_end_ms=1_795_000_000_123,
    stick_band=Bounded(11.0, 10.5, 11.5),
    confidence=0.9,
    samples=800,
    fit=0.96875,
    evidence=123.5,
)
ORDERS: list[Order] = ["big", "little"]


def field_words(words: list[int], name: str) -> list[int]:
    (field,) = [field for field in BLOCK_FIELDS if field.name == name]
    return words[field.offset : field.end]


def real(name: str, order: Order) -> float:
    value = ModbusClientMixin.convert_from_registers(
        field_words(encode_block(BLOCK, order), name), ModbusClientMixin.DATATYPE.FLOAT32, order
    )
    assert isinstance(value, float)
    return value


def test_one_write_request_holds_a_block() -> None:
    assert BLOCK_REGISTERS <= 123


def test_fields_follow_each_other_and_are_aligned() -> None:
    offset = 0
    for field in BLOCK_FIELDS:
        assert field.offset == offset
        assert field.offset % field.data_type.registers == 0
        offset = field.end
    assert offset == BLOCK_REGISTERS


@pytest.mark.parametrize("order", ORDERS)
def test_pymodbus_reads_the_values_of_a_block(order: Order) -> None:
    assert real("stick_band", order) == 11.0
    assert real("stick_band_low", order) == 10.5
    assert real("stick_band_high", order) == 11.5
    assert real("slip_jump", order) == 3.0
    assert real("static_friction", order) == 7.0
    assert real("dynamic_friction", order) == 4.0
    assert real("gain", order) == pytest.approx(PROCESS.gain, rel=1e-6)
    a1 = field_words(encode_block(BLOCK, order), "a1")
    double = ModbusClientMixin.DATATYPE.FLOAT64
    assert ModbusClientMixin.convert_from_registers(a1, double, order) == PROCESS.a[0]


def test_the_head_is_plain_words() -> None:
    words = encode_block(BLOCK)
    assert words[:6] == [0x464C, 1, 101, 7, Status.VALID, BLOCK_REGISTERS]
    utc = struct.unpack(">Q", struct.pack(">4H", *field_words(words, "window_end")))[0]
    assert utc == 1_795_000_000_123


def test_the_crc_is_the_one_of_modbus_rtu() -> None:
    words = encode_block(BLOCK)
    on_the_wire = b"".join(word.to_bytes(2, "big") for word in words[:-2])
    theirs = FramerRTU.compute_CRC(on_the_wire)
    # pymodbus returns it swapped, as RTU sends the low byte first.
    assert words[-2] == int.from_bytes(theirs.to_bytes(2, "big"), "little")


def test_the_check_value_of_crc_16_modbus() -> None:
    # The catalogue's check value, 0x4B37 for "123456789", has an odd number of bytes; one step more
    # by hand from the CRC of the first eight.
    crc = crc16([0x3132, 0x3334, 0x3536, 0x3738]) ^ ord("9")
    for _ in range(8):
        crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    assert crc == 0x4B37


@pytest.mark.parametrize("order", ORDERS)
def test_a_block_survives_its_registers(order: Order) -> None:
    found = decode_block(encode_block(BLOCK, order), order)
    assert replace(found, confidence=BLOCK.confidence, process=PROCESS) == BLOCK
    assert found.confidence == pytest.approx(0.9)
    assert found.model is not None
    assert found.model.valve == MODEL.valve
    assert found.model.process == PROCESS  # also the period of 0.1, which no float32 holds


def test_slow_third_order_processes_keep_their_dynamics() -> None:
    poles = np.exp(-1.0 / np.array([50.0, 60.0, 80.0]))
    a = tuple(float(value) for value in np.poly(poles)[1:])
    process = ProcessModel(
        a=a, b=(float(np.polyval(np.poly(poles), 1.0)),), dead_time=1, offset=0.0, period=1.0
    )
    block = replace(BLOCK, process=process)
    found = decode_block(encode_block(block)).process
    assert found is not None
    np.testing.assert_allclose(np.sort(np.roots([1.0, *found.a]).real), np.sort(poles), rtol=1e-9)


def test_gain_and_time_constant_of_a_first_order_process() -> None:
    pole = math.exp(-10.0 / 120.0)
    process = ProcessModel(a=(-pole,), b=(2.5 * (1 - pole),), dead_time=3, offset=0.0, period=10.0)
    block = replace(BLOCK, process=process)
    assert block.gain == pytest.approx(2.5)
    assert block.time_constant == pytest.approx(120.0)


def test_an_integrating_process_gives_its_slope() -> None:
    # PV rises by 0.02 a sample of 10 s for every unit of OP.
    process = ProcessModel(a=(-1.0,), b=(0.02,), dead_time=1, offset=0.0, period=10.0)
    block = replace(BLOCK, process=process)
    assert block.gain == pytest.approx(0.002)
    assert block.time_constant == 0.0
    assert field_words(encode_block(block), "process_kind") == [2]


def test_an_integrating_process_with_a_lag_gives_slope_and_lag() -> None:
    lag = math.exp(-1.0 / 5.0)
    process = ProcessModel(
        a=(-1.0 - lag, lag), b=(0.3 * (1.0 - lag),), dead_time=1, offset=0.0, period=1.0
    )
    rise = np.diff(process.simulate(np.concatenate([[0.0], np.ones(200)])))[-1]
    block = replace(BLOCK, process=process)
    assert block.gain == pytest.approx(rise)
    assert block.time_constant == pytest.approx(5.0)


def test_all_zero_is_no_block() -> None:
    with pytest.raises(BlockError) as caught:
        decode_block([0] * BLOCK_REGISTERS)
    assert caught.value.reason is BlockFault.EMPTY


@given(offset=st.integers(0, BLOCK_REGISTERS - 1), word=st.integers(0, 0xFFFF))
def test_no_changed_register_goes_unnoticed(offset: int, word: int) -> None:
    words = encode_block(BLOCK)
    if words[offset] == word:
        return
    words[offset] = word
    with pytest.raises(BlockError):
        decode_block(words)


@given(cut=st.integers(0, BLOCK_REGISTERS))
def test_a_torn_write_is_the_old_block_the_new_one_or_none(cut: int) -> None:
    older = encode_block(BLOCK)
    newer = encode_block(replace(BLOCK, seq=8, stick_band=Bounded(11.0, 10.0, 12.0)))
    torn = newer[:cut] + older[cut:]
    if torn in (older, newer):
        assert decode_block(torn) in (decode_block(older), decode_block(newer))
        return
    with pytest.raises(BlockError):
        decode_block(torn)


@given(words=st.lists(st.integers(0, 0xFFFF), min_size=BLOCK_REGISTERS, max_size=BLOCK_REGISTERS))
def test_any_registers_make_a_block_or_a_block_error(words: list[int]) -> None:
    words[0] = 0x464C
    words[1], words[5] = 1, BLOCK_REGISTERS
    words[-2] = crc16(words[:-2])
    words[-1] = words[3]
    try:
        block = decode_block(words)
    except BlockError:
        return
    assert 0.0 <= block.slip_jump.value <= block.stick_band.value


def damaged(name: str, words: list[int]) -> list[int]:
    block = encode_block(BLOCK)
    (field,) = [field for field in BLOCK_FIELDS if field.name == name]
    block[field.offset : field.end] = words
    if name not in ("crc", "seq_again"):
        block[-2] = crc16(block[:-2])
    if name == "seq":
        block[-1] = words[0]
    return block


@pytest.mark.parametrize(
    ("name", "words", "fault"),
    [
        ("magic", [0x4C46], BlockFault.MAGIC),
        ("version", [2], BlockFault.VERSION),
        ("length", [78], BlockFault.VERSION),
        ("crc", [0], BlockFault.CRC),
        ("seq_again", [8], BlockFault.SEQ_TORN),
        ("seq", [0], BlockFault.SEQ_ZERO),
        ("status", [0], BlockFault.STATUS),
        ("status", [5], BlockFault.STATUS),
        ("verdict", [9], BlockFault.STATUS),
        ("stick_band", [0x7FC0, 0], BlockFault.OUT_OF_RANGE),  # NaN
        ("stick_band", [0xC130, 0], BlockFault.OUT_OF_RANGE),  # -11
        ("slip_jump", [0x4140, 0], BlockFault.OUT_OF_RANGE),  # 12, above S
        ("static_friction", [0x40E6, 0x6666], BlockFault.OUT_OF_RANGE),  # 7.2, above its bound
        ("dead_time", [3], None),
        ("na", [5], BlockFault.OUT_OF_RANGE),
        ("process_kind", [0], BlockFault.OUT_OF_RANGE),
        ("period", [0, 0], BlockFault.OUT_OF_RANGE),
        ("valid_for", [0, 0], BlockFault.OUT_OF_RANGE),
        ("loop_id", [0], BlockFault.OUT_OF_RANGE),
        ("a1", [0x7FF0, 0, 0, 0], BlockFault.OUT_OF_RANGE),  # infinite
    ],
)
def test_each_fault_has_its_name(name: str, words: list[int], fault: BlockFault | None) -> None:
    if fault is None:
        assert decode_block(damaged(name, words)).process != PROCESS
        return
    with pytest.raises(BlockError) as caught:
        decode_block(damaged(name, words))
    assert caught.value.reason is fault
    assert fault.advice in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({"loop_id": 0}, "1 to 65535"),
        ({"valid_for": 2**32}, "4294967295"),
        ({"fit": math.nan}, "REAL"),
        ({"evidence": 1e39}, "REAL"),
        ({"stick_band": Bounded(11.0, 11.5, 12.0)}, "stick_band"),
        ({"slip_jump": Bounded.exact(12.0)}, "above stick_band"),
        ({"static_friction": Bounded.exact(8.0)}, "do not belong"),
        ({"process": replace(PROCESS, a=(0.1,) * 5)}, "limit 4"),
        ({"process": replace(PROCESS, dead_time=65536)}, "dead_time = 65536"),
    ],
)
def test_a_block_that_could_not_be_sent_cannot_be_made(
    changes: dict[str, object], limit: str
) -> None:
    with pytest.raises(BlockError, match=limit):
        replace(BLOCK, **changes)  # type: ignore[arg-type]


def test_a_block_without_a_model_says_so() -> None:
    healthy = ParameterBlock(
        loop_id=1, seq=1, status=Status.NO_STICTION, valid_for=60, verdict=Verdict.NO_STICTION
    )
    found = decode_block(encode_block(healthy))
    assert found.status is Status.NO_STICTION
    assert found.model is None
    assert replace(BLOCK, process=None).model is None


def test_verdicts_go_by_the_estimator_s_names() -> None:
    assert Verdict.of("not_assessable") is Verdict.NOT_ASSESSABLE


def test_the_sequence_never_becomes_zero() -> None:
    assert [next_seq(seq) for seq in (0, 1, 65534, 65535)] == [1, 2, 65535, 1]


@given(seq=st.integers(1, 65535), steps=st.integers(1, 32767))
def test_newer_is_up_to_half_the_circle_ahead(seq: int, steps: int) -> None:
    later = (seq - 1 + steps) % 65535 + 1
    assert is_newer(later, seq)
    assert not is_newer(seq, later)


def test_the_same_number_is_not_newer_and_any_is_newer_than_none() -> None:
    assert not is_newer(5, 5)
    assert is_newer(1, 65535)
    assert is_newer(40000, 0)


def test_result_codes_are_distinct_and_explained() -> None:
    codes = [fault.code for fault in BlockFault]
    assert len({NOTHING_SEEN, ACCEPTED, *codes}) == len(codes) + 2
    assert describe_ack(ACCEPTED) == "accepted"
    assert "torn" in describe_ack(BlockFault.CRC.code)
    assert "unknown result code 77" in describe_ack(77)
