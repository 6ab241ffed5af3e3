"""Blocks arriving in the simulated PLC: what it accepts, refuses and acknowledges."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from fieldlink.lab.plc import PlcError, VirtualPlc
from fieldlink.lab.plc.image import RequestRefusedError
from fieldlink.registers import (
    ACCEPTED,
    BLOCK_REGISTERS,
    Bank,
    BlockFault,
    ExchangeLayout,
    Fallback,
    ParameterBlock,
    Table,
    encode_block,
)
from fieldlink.site import Site
from loop_model import ValveModel

MakeSite = Callable[..., Site]
MakeBlock = Callable[..., ParameterBlock]

AREA = ExchangeLayout.at(100)


def test_a_sound_block_is_accepted_and_acknowledged(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(3)
        assert plc.block("FC101").fallback is Fallback.NO_BLOCK
        writer.send(make_block(7))
        writer.run(1)
        assert writer.answer == (7, ACCEPTED)
        assert plc.image.read(Table.HOLDING, AREA.active_bank, 1) == [Bank.B]
        state = plc.block("FC101")
        assert state.in_force.stick_band.value == 11.0
        writer.send(make_block(8), Bank.A)
        writer.run(1)
        assert writer.answer == (8, ACCEPTED)
        assert plc.image.read(Table.HOLDING, AREA.active_bank, 1) == [Bank.A]


def test_enable_is_the_operators_and_a_client_writes_it_only_where_it_is_his_switch(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with (
        VirtualPlc(make_site(), "plc") as plc,
        pytest.raises(RequestRefusedError, match="100 is read-only"),
    ):
        plc.image.write(Table.HOLDING, AREA.enable, [0])
    with VirtualPlc(make_site(), "plc", operator_switch=True) as plc:
        writer = writer_of(plc)
        writer.run(3)
        writer.send(make_block(7))
        writer.run(1)
        assert plc.block("FC101").in_force is not None
        plc.image.write(Table.HOLDING, AREA.enable, [0])
        writer.run(1)
        assert plc.block("FC101").fallback is Fallback.DISABLED
        plc.image.write(Table.HOLDING, AREA.enable, [1])
        writer.run(1)
        assert plc.block("FC101").in_force.seq == 7
        # What the PLC answers stays its own.
        with pytest.raises(RequestRefusedError, match="101 is read-only"):
            plc.image.write(Table.HOLDING, AREA.ack_seq, [3])


def spoil_crc(words: list[int]) -> list[int]:
    return [*words[:30], words[30] ^ 1, *words[31:]]


def tear(words: list[int]) -> list[int]:
    """The end of an older block under a newer head, with a CRC that fits what is before it."""
    return [*words[:-1], words[-1] - 1]


@pytest.mark.parametrize(
    ("spoil", "fault"), [(spoil_crc, BlockFault.CRC), (tear, BlockFault.SEQ_TORN)]
)
def test_a_damaged_block_is_refused_and_the_accepted_one_stays(
    make_site: MakeSite,
    make_block: MakeBlock,
    writer_of: Callable,
    spoil: Callable[[list[int]], list[int]],
    fault: BlockFault,
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(3)
        writer.send(make_block(7))
        writer.run(1)
        writer.send_words(spoil(encode_block(make_block(8), "big")), 8, Bank.A)
        writer.run(1)
        assert writer.answer == (7, fault.code)
        assert plc.block("FC101").in_force.seq == 7


def test_blocks_that_do_not_follow_or_fit_are_refused(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(3)
        writer.send(make_block(7))
        writer.run(1)
        # The site allows 15 at most.
        too_sticky = make_block(8, valve=ValveModel(15.5, 3.0))
        for block, fault in (
            (make_block(6), BlockFault.NOT_NEWER),
            (make_block(8, loop_id=102), BlockFault.WRONG_LOOP),
            (too_sticky, BlockFault.OUT_OF_RANGE),
        ):
            writer.send(block, Bank.A)
            writer.run(1)
            assert writer.answer == (7, fault.code)
            assert plc.block("FC101").in_force.seq == 7


def test_nothing_is_accepted_while_the_operator_has_it_disabled(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        assert plc.image.read(Table.HOLDING, AREA.enable, 1) == [1]
        plc.enable("FC101", False)
        writer.run(3)
        writer.send(make_block(7))
        writer.run(1)
        assert writer.answer == (0, BlockFault.NOT_ENABLED.code)
        plc.enable("FC101", True)
        writer.run(1)
        assert writer.answer == (0, BlockFault.NOT_ENABLED.code)
        writer.send(make_block(8))
        writer.run(1)
        assert writer.answer == (8, ACCEPTED)


def test_fieldlink_cannot_write_what_is_the_plc_s(make_site: MakeSite) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        for address in (AREA.enable, AREA.ack_seq, AREA.ack_result, AREA.active_bank):
            with pytest.raises(RequestRefusedError, match=f"{address} is read-only"):
                plc.image.write(Table.HOLDING, address, [1])
        assert plc.image.read(Table.HOLDING, AREA.bank_b, BLOCK_REGISTERS) == [0] * BLOCK_REGISTERS
        # The compact area is one run of registers, so one request can read it.
        plc.image.read(Table.HOLDING, AREA.enable, AREA.bank_a - AREA.enable)


def test_a_loop_without_an_exchange_area_has_nothing_to_enable(make_site: MakeSite) -> None:
    site = make_site(plant='fmu = "example1"').with_loop("FC101", writeback={})
    with VirtualPlc(site, "plc") as plc:
        plc.scan()
        assert plc.block("FC101") is None
        with pytest.raises(PlcError, match="loop FC101 has no exchange area"):
            plc.enable("FC101", True)


def test_a_little_endian_block_is_read_as_such(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(device='word_order = "little"'), "plc") as plc:
        writer = writer_of(plc, "little")
        writer.run(3)
        writer.send(make_block(7))
        writer.run(1)
        assert plc.block("FC101").in_force.slip_jump.value == 3.0
