"""The simulated PLC on a real socket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from pymodbus.client import AsyncModbusTcpClient

from fieldlink.lab.plc import PlcError, PlcServer, PortError, VirtualPlc, serve
from fieldlink.lab.plc import server as pacing
from fieldlink.lab.plc.server import ServedUnit
from fieldlink.registers import (
    ACCEPTED,
    Bank,
    DataType,
    ExchangeLayout,
    ParameterBlock,
    commit_word,
    decode,
    encode_block,
)
from fieldlink.site import Site

MakeSite = Callable[..., Site]
MakeBlock = Callable[..., ParameterBlock]

AREA = ExchangeLayout.at(100)


@asynccontextmanager
async def served(site: Site, **options: object) -> AsyncIterator[PlcServer]:
    """Serve a site of one endpoint on a free port until the block ends."""
    stop = asyncio.Event()
    ready: asyncio.Future[PlcServer] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(
        serve(
            site, port=0, ready=lambda servers: ready.set_result(servers[0]), stop=stop, **options
        )
    )
    await asyncio.wait({serving, ready}, return_when=asyncio.FIRST_COMPLETED)
    if serving.done():
        await serving
    try:
        yield ready.result()
    finally:
        stop.set()
        await serving


@asynccontextmanager
async def connected(server: PlcServer) -> AsyncIterator[AsyncModbusTcpClient]:
    client = AsyncModbusTcpClient("127.0.0.1", port=server.port, timeout=60.0, retries=0)
    assert await client.connect()
    try:
        yield client
    finally:
        client.close()


async def test_concurrent_reads_never_mix_two_scans(make_site: MakeSite) -> None:
    seen: list[list[int]] = []

    def scans() -> int:
        return len({decode(words[7:9], DataType.UINT32) for words in seen})

    async def poll(server: PlcServer) -> None:
        async with connected(server) as client:
            # A fast machine reads a scan many times.
            while scans() < 60:
                seen.append((await client.read_holding_registers(0, count=9)).registers)

    async with served(make_site(), speed=500.0) as server:
        await asyncio.gather(poll(server), poll(server), poll(server))
        (unit,) = server.units
        truth = unit.plc.truth("FC101")
    for words in seen:
        cycle = int(decode(words[7:9], DataType.UINT32)) - 1
        assert decode(words[0:2], DataType.FLOAT32) == np.float32(truth.op[cycle])
        assert decode(words[2:4], DataType.FLOAT32) == np.float32(truth.pv[cycle])


async def test_one_fc16_is_one_change(make_site: MakeSite) -> None:
    async with served(make_site()) as server, connected(server) as a, connected(server) as b:
        torn = 0

        async def write() -> None:
            for k in range(200):
                await a.write_registers(AREA.bank_a, [k] * 60)

        async def read() -> None:
            nonlocal torn
            for _ in range(200):
                words = (await b.read_holding_registers(AREA.bank_a, count=60)).registers
                torn += len(set(words)) != 1

        await asyncio.gather(write(), read())
        assert torn == 0


async def test_a_block_sent_over_the_wire_is_acknowledged(
    make_site: MakeSite, make_block: MakeBlock
) -> None:
    words = encode_block(make_block(3), "big")
    async with served(make_site()) as server, connected(server) as client:
        assert not (await client.write_registers(AREA.bank_b, words)).isError()
        back = await client.read_holding_registers(AREA.bank_b, count=len(words))
        assert back.registers == words
        await client.write_register(AREA.commit, commit_word(Bank.B, 3))
        async with asyncio.timeout(60.0):
            acknowledged = [0, 0]
            while acknowledged[0] != 3:
                await asyncio.sleep(0.01)
                reply = await client.read_holding_registers(AREA.ack_seq, count=2)
                acknowledged = reply.registers
        assert acknowledged == [3, ACCEPTED]


async def test_refusals_carry_the_standard_s_exception_codes(make_site: MakeSite) -> None:
    async with served(make_site()) as server, connected(server) as client:
        assert (await client.read_holding_registers(5000, count=1)).exception_code == 2
        assert (await client.write_register(AREA.ack_seq, 9)).exception_code == 2
        assert (await client.write_registers(0, [1, 2])).exception_code == 2


async def test_the_first_reply_already_holds_a_scan(make_site: MakeSite) -> None:
    async with PlcServer({1: VirtualPlc(make_site(), "plc")}) as server, connected(server) as c:
        reply = await c.read_holding_registers(0, count=9)
        assert decode(reply.registers[7:9], DataType.UINT32) == 1
        assert decode(reply.registers[4:6], DataType.FLOAT32) == 55.0


class CostlyClock:
    """A clock that moves by what is slept, and by what the test says that a scan costs."""

    def __init__(self, ends: float, stop: asyncio.Event) -> None:
        self.now = 0.0
        self._ends = ends
        self._stop = stop

    def monotonic(self) -> float:
        return self.now

    def utc(self) -> float:
        return self.now

    async def sleep_until(self, moment: float) -> None:
        self.now = max(self.now, moment)
        if self.now >= self._ends:
            self._stop.set()
        await asyncio.sleep(0)


class CountingPlc:
    """The part of a PLC that pacing uses."""

    device, speed, scan_period, failures = "plc", 50.0, 1.0, MappingProxyType({})
    pace = "clock"

    def __init__(self, cost: Callable[[int], float]) -> None:
        self.scans = 0
        self.clock: CostlyClock
        self._cost = cost

    def scan(self) -> None:
        self.clock.now += self._cost(self.scans)
        self.scans += 1


async def run_until(plc: CountingPlc, ends: float) -> ServedUnit:
    """Run a PLC with a scan every 20 ms until the clock says ``ends``."""
    stop = asyncio.Event()
    plc.clock = CostlyClock(ends, stop)
    server = PlcServer({1: plc}, clock=plc.clock)
    await server.run(stop)
    return server.units[0]


async def test_plant_time_is_the_wall_clock_s_times_speed() -> None:
    unit = await run_until(CountingPlc(lambda _: 0.019), 3.0)
    assert unit.plc.scans == pytest.approx(150, abs=2)
    assert unit.late == 0


async def test_a_late_scan_is_counted_and_caught_up() -> None:
    unit = await run_until(CountingPlc(lambda k: 0.1 if k == 50 else 0.001), 3.0)
    assert unit.plc.scans == pytest.approx(150, abs=2)
    assert 4 <= unit.late <= 5  # the long one, and those that run after it
    assert unit.left_out == 0.0


async def test_a_suspended_machine_does_not_catch_up() -> None:
    unit = await run_until(CountingPlc(lambda k: 60.0 if k == 50 else 0.001), 63.0)
    assert unit.plc.scans == pytest.approx(150, abs=3)
    assert unit.left_out == pytest.approx(60.0, abs=0.1)


class ReaderPacedPlc(CountingPlc):
    """Its client reads a scan so many seconds after it, once it has come."""

    pace = "reader"

    def __init__(self, reads_after: Callable[[float], float]) -> None:
        super().__init__(lambda _: 0.001)
        self._reads_after = reads_after
        self._at = 0.0
        self.moments: list[float] = []

    @property
    def is_read(self) -> bool:
        return self.clock.now >= self._at + self._reads_after(self._at)

    def scan(self) -> None:
        super().scan()
        self._at = self.clock.now
        self.moments.append(self._at)


async def test_a_scan_paced_by_its_reader_waits_for_the_read() -> None:
    quick = await run_until(ReaderPacedPlc(lambda _: 0.01), 3.0)
    assert quick.plc.scans == pytest.approx(150, abs=2)
    # A busy machine reads 70 ms after a scan: no scan goes unread, and nothing is caught up after.
    busy = await run_until(ReaderPacedPlc(lambda at: 0.07 if 1.0 < at < 2.0 else 0.01), 3.0)
    between = np.diff(busy.plc.moments)
    slow = (np.array(busy.plc.moments[1:]) > 1.1) & (np.array(busy.plc.moments[1:]) < 2.0)
    assert (between[slow] >= 0.07).all()
    assert between.min() >= 0.019


async def test_a_reader_that_stays_away_is_waited_for_once() -> None:
    """Before the first read nobody is waited for; after the last one two seconds, once."""
    never = await run_until(ReaderPacedPlc(lambda _: 1e9), 3.0)
    assert never.plc.scans == pytest.approx(150, abs=2)
    leaves = await run_until(ReaderPacedPlc(lambda at: 0.01 if at < 1.0 else 1e9), 5.0)
    waits = np.diff(leaves.plc.moments)
    assert np.count_nonzero(waits > 0.1) == 1
    assert waits.max() == pytest.approx(2.0, abs=0.1)


async def test_every_scan_of_a_plc_paced_by_its_reader_is_read(
    make_site: MakeSite, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over a real socket: a client that reads every 30 ms misses no scan of 2 ms."""
    monkeypatch.setattr(pacing, "READER_PATIENCE", 60.0)
    counts = []
    site = make_site(device='pace = "reader"')
    async with served(site, speed=500.0) as plc, connected(plc) as client:
        for _ in range(40):
            words = (await client.read_holding_registers(0, count=9)).registers
            counts.append(int(decode(words[7:9], DataType.UINT32)))
            await asyncio.sleep(0.03)
    assert set(np.diff(counts)) <= {0, 1}
    assert counts[-1] > counts[0]


async def test_a_port_in_use_is_an_error_with_a_remedy(make_site: MakeSite) -> None:
    async with served(make_site()) as server:
        with pytest.raises(PortError, match=rf"127.0.0.1:{server.port}: Address already in use"):
            await serve(make_site(), port=server.port)


async def test_two_units_behind_one_port(make_site: MakeSite, tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("tag,address,type\nX.OP,0,uint16\nX.PV,1,uint16\n")
    (tmp_path / "x.csv").write_text("op,pv\n" + "40,7\n" * 50)
    more = """\
[devices.second]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5020
unit = 9
register_map = "other.csv"
[loops.X]
device = "second"
op = "X.OP"
pv = "X.PV"
period = 1.0
[loops.X.plant]
recording = "x.csv"
"""
    async with served(make_site(more=more)) as server, connected(server) as client:
        first = await client.read_holding_registers(4, count=2, device_id=1)
        assert decode(first.registers, DataType.FLOAT32) == 55.0
        second = await client.read_holding_registers(0, count=2, device_id=9)
        assert second.registers == [40, 7]
        assert (await client.read_holding_registers(0, count=1, device_id=4)).exception_code == 11


async def test_one_port_cannot_stand_for_two_endpoints(make_site: MakeSite, tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("tag,address,type\nX.OP,0,uint16\nX.PV,1,uint16\n")
    (tmp_path / "x.csv").write_text("op,pv\n" + "40,7\n" * 50)
    more = """\
[devices.second]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5021
register_map = "other.csv"
[loops.X]
device = "second"
op = "X.OP"
pv = "X.PV"
period = 1.0
[loops.X.plant]
recording = "x.csv"
"""
    with pytest.raises(PlcError, match=r"--port .* has 2 \(127.0.0.1:5020, 127.0.0.1:5021\)"):
        await serve(make_site(more=more), port=0)


async def test_a_site_without_plants_cannot_be_served(make_site: MakeSite) -> None:
    with pytest.raises(PlcError, match="no Modbus device has a loop with a plant"):
        await serve(make_site().with_loop("FC101", plant=None))
