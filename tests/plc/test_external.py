"""A controller outside: a Modbus client reads PV and writes OP, until it falls silent."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from pymodbus.client import AsyncModbusTcpClient

from compensator import PiController, PiSettings
from fieldlink.lab.plc import VirtualPlc, serve
from fieldlink.lab.plc.op_sources import ClientState
from fieldlink.registers import DataType, Table, decode, encode
from fieldlink.site import Site, SiteError, load_site

SITE = """\
[site]
name = "outside"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5020
register_map = "map.csv"
speed = {speed}
[loops.LC]
device = "plc"
op = "LC.OP"
pv = "LC.PV"
sp = "LC.SP"
mode = "LC.MODE"
scan = "LC.SCAN"
period = 1.0
[loops.LC.plant]
fmu = "level"
controller = "external"
setpoint = [[0, 52]]
parameters = {{ valve = 0, op_start = 50.0 }}
{plant}
[loops.LC.plant.external]
status = "LC.STATUS"
{external}
"""
MAP = """\
tag,table,address,type,low,high,writable
LC.OP,holding,0,float32,0,100,yes
LC.PV,holding,2,float32,,,
LC.SP,holding,4,float32,,,
LC.MODE,holding,6,uint16,,,yes
LC.SCAN,holding,7,uint32,,,
LC.STATUS,holding,9,uint16,,,
"""

MakeSite = Callable[..., Site]


@pytest.fixture
def make_outside(tmp_path: Path) -> MakeSite:
    """Write a site whose only loop is controlled from outside, and load it."""

    def make(
        external: str = "", *, plant: str = "", speed: float = 50.0, registers: str = MAP
    ) -> Site:
        (tmp_path / "map.csv").write_text(registers)
        path = tmp_path / "site.toml"
        path.write_text(SITE.format(external=external, plant=plant, speed=speed))
        return load_site(path)

    return make


def write_op(plc: VirtualPlc, op: float) -> None:
    plc.image.write(Table.HOLDING, 0, encode(op, DataType.FLOAT32))


def shown(plc: VirtualPlc) -> tuple[float, int, int]:
    """OP, mode and status as a client reads them."""
    words = plc.image.read(Table.HOLDING, 0, 10)
    return float(decode(words[0:2], DataType.FLOAT32)), words[6], words[9]


def scan(plc: VirtualPlc, times: int = 1) -> None:
    for _ in range(times):
        plc.scan()


def test_op_is_what_the_client_writes(make_outside: MakeSite) -> None:
    with VirtualPlc(make_outside(), "plc") as plc:
        for op in (51.0, 51.0, 48.5):
            write_op(plc, op)
            scan(plc)
            assert shown(plc) == (op, 1, ClientState.IN_COMMAND)
        assert plc.truth("LC").stem.tolist() == [51.0, 51.0, 48.5]


def test_hold_keeps_op_and_says_so(make_outside: MakeSite) -> None:
    with VirtualPlc(make_outside("timeout = 3.0"), "plc") as plc:
        write_op(plc, 47.0)
        scan(plc, 4)
        assert shown(plc) == (47.0, 1, ClientState.IN_COMMAND)
        scan(plc)
        assert shown(plc) == (47.0, 1, ClientState.HELD)
        write_op(plc, 47.0)  # the same value is a sign of life, too
        scan(plc)
        assert shown(plc) == (47.0, 1, ClientState.IN_COMMAND)


def test_a_client_that_never_writes_is_gone_as_well(make_outside: MakeSite) -> None:
    with VirtualPlc(make_outside("timeout = 3.0"), "plc") as plc:
        scan(plc, 3)
        assert shown(plc) == (50.0, 1, ClientState.IN_COMMAND)
        scan(plc)
        assert shown(plc) == (50.0, 1, ClientState.HELD)


def test_fail_safe_goes_to_its_op(make_outside: MakeSite) -> None:
    external = 'timeout = 3.0\npolicy = "fail_safe"\nfail_safe_op = 5.0'
    with VirtualPlc(make_outside(external), "plc") as plc:
        write_op(plc, 60.0)
        scan(plc, 5)
        assert shown(plc) == (5.0, 1, ClientState.FAIL_SAFE)
        write_op(plc, 55.0)
        scan(plc)
        assert shown(plc) == (55.0, 1, ClientState.IN_COMMAND)


def test_the_plc_s_own_pi_takes_over_without_a_bump(make_outside: MakeSite) -> None:
    external = 'timeout = 3.0\npolicy = "take_over"'
    site = make_outside(external, plant="pi = { gain = 4.0, integral_time = 100.0 }")
    with VirtualPlc(site, "plc") as plc:
        write_op(plc, 51.0)
        scan(plc, 5)
        op, mode, status = shown(plc)
        assert (mode, status) == (1, ClientState.TAKEN_OVER)
        assert op == pytest.approx(51.0, abs=0.5)
        scan(plc, 600)
        truth = plc.truth("LC")
        assert np.mean(truth.pv[-100:]) == pytest.approx(52.0, abs=0.2)
        write_op(plc, 50.0)
        scan(plc)
        assert shown(plc) == (50.0, 1, ClientState.IN_COMMAND)


def test_an_operator_in_manual_is_no_silent_client(make_outside: MakeSite) -> None:
    with VirtualPlc(make_outside("timeout = 3.0"), "plc") as plc:
        plc.image.write(Table.HOLDING, 6, [0])
        write_op(plc, 42.0)
        scan(plc, 20)
        assert shown(plc) == (42.0, 0, ClientState.MANUAL)


def test_a_refused_write_is_no_sign_of_life(make_outside: MakeSite) -> None:
    from fieldlink.lab.plc.image import RequestRefusedError

    with VirtualPlc(make_outside("timeout = 3.0"), "plc") as plc:
        for _ in range(5):
            with pytest.raises(RequestRefusedError):
                write_op(plc, 101.0)
            scan(plc)
        assert shown(plc) == (50.0, 1, ClientState.HELD)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"external": 'policy = "fail_safe"'}, "fail_safe_op belong together"),
        ({"external": 'policy = "take_over"'}, "table pi belong together"),
        ({"plant": "compensate = true"}, 'the compensator takes the loop over .* "external" is'),
        (
            {"registers": MAP.replace("0,float32,0,100,yes", "0,float32,0,100,")},
            "a controller outside writes OP, and LC.OP is not writable in the register map; set",
        ),
        (
            {"registers": MAP.replace("LC.STATUS", "LC.STATE")},
            "no tag 'LC.STATUS'; did you mean 'LC.STATE'",
        ),
    ],
)
def test_a_site_that_does_not_fit_is_refused(
    make_outside: MakeSite, change: dict[str, str], message: str
) -> None:
    with pytest.raises(SiteError, match=message):
        make_outside(**change)


@asynccontextmanager
async def served(site: Site) -> AsyncIterator[AsyncModbusTcpClient]:
    """Serve a site on a free port, with a client that is connected."""
    stop = asyncio.Event()
    ready: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(
        serve(site, port=0, ready=lambda servers: ready.set_result(servers[0].port), stop=stop)
    )
    await asyncio.wait({serving, ready}, return_when=asyncio.FIRST_COMPLETED)
    client = AsyncModbusTcpClient("127.0.0.1", port=ready.result(), timeout=60.0, retries=0)
    try:
        assert await client.connect()
        yield client
    finally:
        client.close()
        stop.set()
        await serving


async def until(client: AsyncModbusTcpClient, status: ClientState) -> list[int]:
    """Poll until the status register shows ``status``; return the ten registers."""
    async with asyncio.timeout(30.0):
        while True:
            words = (await client.read_holding_registers(0, count=10)).registers
            if words[9] == status:
                return list(words)
            await asyncio.sleep(0.02)


@pytest.mark.slow
async def test_a_client_controls_over_the_wire_and_is_replaced_when_it_dies(
    make_outside: MakeSite,
) -> None:
    site = make_outside(
        'timeout = 20.0\npolicy = "take_over"',
        plant="pi = { gain = 4.0, integral_time = 100.0 }",
        speed=100.0,
    )
    controller = PiController(PiSettings(gain=6.0, integral_time=80.0, period=1.0))
    async with served(site) as client:
        seen, in_command, pvs = 0, 0, []
        async with asyncio.timeout(60.0):
            while seen < 400:
                words = (await client.read_holding_registers(0, count=10)).registers
                scans = int(decode(words[7:9], DataType.UINT32))
                if scans == seen:
                    await asyncio.sleep(0.002)
                    continue
                seen = scans
                in_command += words[9] == ClientState.IN_COMMAND
                op, pv, sp = (decode(words[k : k + 2], DataType.FLOAT32) for k in (0, 2, 4))
                pvs.append(pv)
                controller.observe(float(pv), float(op))
                wanted = controller.decide(float(sp)).op
                reply = await client.write_registers(0, encode(wanted, DataType.FLOAT32))
                assert not reply.isError()
        # Whenever the machine let it write in time.
        assert in_command > 0.5 * len(pvs)
        assert np.mean(pvs[-50:]) == pytest.approx(52.0, abs=0.5)
        words = await until(client, ClientState.TAKEN_OVER)  # it writes no more
        assert words[6] == 1
        assert decode(words[2:4], DataType.FLOAT32) == pytest.approx(52.0, abs=1.5)
        await client.write_registers(0, encode(50.0, DataType.FLOAT32))
        await until(client, ClientState.IN_COMMAND)
