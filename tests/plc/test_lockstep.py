"""The lockstep link: the simulated PLC as a peer of the Modbus link, moved by its reader."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fieldlink.lab.plc import LockstepLink
from fieldlink.links import (
    ExceptionReplyError,
    LinkState,
    LinkUnreachableError,
    Quality,
    RegisterAccess,
    VirtualClock,
    open_link,
)
from fieldlink.registers import (
    ACCEPTED,
    Bank,
    ExchangeLayout,
    ParameterBlock,
    commit_word,
    encode_block,
)
from fieldlink.site import Site

MakeSite = Callable[..., Site]
MakeBlock = Callable[..., ParameterBlock]

AREA = ExchangeLayout.at(100)


def lockstep(site: Site) -> LockstepLink:
    link = open_link(site.with_device("plc", link="fmu"), "plc", VirtualClock())
    assert isinstance(link, LockstepLink)
    assert isinstance(link, RegisterAccess)
    return link


async def test_a_scan_is_a_control_cycle_read_through_the_registers(make_site: MakeSite) -> None:
    link = lockstep(make_site())
    assert link.state is LinkState.CLOSED
    assert link.scan_period == 1.0
    await link.open()
    scans = [await link.scan() for _ in range(20)]
    truth = link.plc.truth("FC101")
    await link.close()
    assert [scan["FC101.SCAN"].value for scan in scans] == list(range(1, 21))
    assert [scan["FC101.PV"].value for scan in scans] == list(truth.pv.astype(np.float32))
    assert [scan["FC101.OP"].value for scan in scans] == list(truth.op.astype(np.float32))
    assert {scan.requests for scan in scans} == {1}
    assert link.state is LinkState.CLOSED


async def test_two_runs_are_the_same(make_site: MakeSite) -> None:
    site = make_site()
    runs = []
    for _ in range(2):
        link = lockstep(site)
        await link.open()
        runs.append([(await link.scan())["FC101.PV"].value for _ in range(100)])
        await link.close()
    assert runs[0] == runs[1]


async def test_blocks_go_through_the_same_exchange(
    make_site: MakeSite, make_block: MakeBlock
) -> None:
    link = lockstep(make_site())
    await link.open()
    await link.scan()
    words = encode_block(make_block(5), "big")
    await link.write_registers(AREA.bank_b, words)
    assert await link.read_registers(AREA.bank_b, len(words)) == words
    await link.write_register(AREA.commit, commit_word(Bank.B, 5))
    await link.scan()
    assert await link.read_registers(AREA.ack_seq, 2) == [5, ACCEPTED]
    await link.close()


async def test_refusals_are_those_of_the_wire(make_site: MakeSite) -> None:
    link = lockstep(make_site())
    await link.open()
    with pytest.raises(ExceptionReplyError, match="ILLEGAL_ADDRESS") as refused:
        await link.write_register(AREA.enable, 1)
    assert refused.value.number == 2
    with pytest.raises(ExceptionReplyError, match="5000 does not exist"):
        await link.read_registers(5000, 1)
    await link.close()


async def test_a_closed_link_says_so_and_may_be_closed_again(make_site: MakeSite) -> None:
    link = lockstep(make_site())
    await link.close()
    with pytest.raises(LinkUnreachableError, match=r"not open; call open\(\) first"):
        await link.read_registers(0, 1)


async def test_a_dead_plant_gives_bad_readings_and_the_link_lives(make_site: MakeSite) -> None:
    link = lockstep(make_site())
    await link.open()
    await link.scan()
    link.plc._loops["FC101"].program.plant.close()
    scan = [await link.scan() for _ in range(2)][-1]
    assert scan["FC101.PV"].quality is Quality.NOT_A_NUMBER
    assert scan["FC101.MODE"].value == 0.0
    assert scan["FC101.SCAN"].value == 3.0
    await link.close()
