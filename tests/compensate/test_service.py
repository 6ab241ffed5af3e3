"""The compensator beside a PLC on a real socket: dry run, permissions, limits, fall-back."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from fieldlink.compensate.memory_file import MemoryFileError
from fieldlink.compensate.service import CompensateError, CompensateService, Step, Verdict
from fieldlink.lab.plc import PlcServer, serve
from fieldlink.registers import (
    Bank,
    DataType,
    ExchangeLayout,
    ParameterBlock,
    Table,
    commit_word,
    decode,
    encode_block,
)
from fieldlink.site import Site, SiteError, load_site
from fmu_models import catalogue
from loop_model import LoopModel

AREA = ExchangeLayout.at(100)
SPEED = 40.0
MAP = """\
tag,table,address,type,low,high,writable
FC101.OP,holding,0,float32,0,100,{writable}
FC101.PV,holding,2,float32,,,
FC101.SP,holding,4,float32,0,100,
FC101.MODE,holding,6,uint16,,,yes
"""
SITE = """\
[site]
name = "test"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5020
register_map = "map.csv"
speed = {speed}
timeout = 3.0
[loops.FC101]
device = "plc"
op = "FC101.OP"
pv = "FC101.PV"
sp = "FC101.SP"
mode = "FC101.MODE"
period = 1.0
[loops.FC101.writeback]
base = 100
loop_id = 101
[loops.FC101.compensate]
enabled = {enabled}
op_out = "FC101.OP"
low = 20.0
high = 80.0
rate = 3.0
[loops.FC101.plant]
fmu = "example1"
controller = "external"
external = {{ timeout = 600.0 }}
setpoint = [[0.0, 54.0]]
parameters = {{ op_start = 50.0 }}
"""


PV_ROW = "FC101.PV,holding,2,float32,0,100,yes"
SECOND_LOOP = """
[loops.FC102]
device = "plc"
op = "FC101.VIEW"
pv = "FC101.PV"
sp = "FC101.SP"
period = 1.0
[loops.FC102.writeback]
base = 400
loop_id = 102
[loops.FC102.compensate]
op_out = "FC101.OP"
"""


def make_site(
    folder: Path, *, enabled: bool = True, writable: str = "yes", limits: str = ""
) -> Site:
    (folder / "map.csv").write_text(MAP.format(writable=writable))
    path = folder / "site.toml"
    text = SITE.format(speed=SPEED, enabled=str(enabled).lower())
    path.write_text(text.replace("loop_id = 101\n", f"loop_id = 101\n{limits}"))
    return load_site(path)


class Plc:
    """The served PLC with what the daemon and the operator do to it."""

    def __init__(self, server: PlcServer) -> None:
        self._plc = server.units[0].plc
        self.image = self._plc.image
        self.port = server.port
        self._beats = 0

    def send_block(self, seq: int = 1, *, age: float = 0.0) -> None:
        plant = catalogue["example1"]
        assert plant.process is not None
        block = ParameterBlock.from_model(
            LoopModel(plant.valve, plant.process),
            loop_id=101,
            seq=seq,
            valid_for=86_400,
            window_end_ms=round(1000.0 * (time.time() - age / SPEED)),
        )
        self.image.write(Table.HOLDING, AREA.bank_address(Bank.B), encode_block(block))
        self.image.write(Table.HOLDING, AREA.commit, [commit_word(Bank.B, seq)])

    def enable(self, on: bool) -> None:
        self._plc.enable("FC101", on)

    def beat(self) -> None:
        self._beats += 1
        self.image.write(Table.HOLDING, AREA.heartbeat, [self._beats])

    @property
    def op(self) -> float:
        return float(decode(self.image.read(Table.HOLDING, 0, 2), DataType.FLOAT32))


@asynccontextmanager
async def served(site: Site, port: int = 0) -> AsyncIterator[Plc]:
    stop = asyncio.Event()
    ready: asyncio.Future[PlcServer] = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(
        serve(site, port=port, ready=lambda servers: ready.set_result(servers[0]), stop=stop)
    )
    await asyncio.wait({task, ready}, return_when=asyncio.FIRST_COMPLETED)
    if task.done():
        await task
    try:
        yield Plc(ready.result())
    finally:
        stop.set()
        await task


async def steps(
    service: CompensateService, plc: Plc, first: int, count: int, *, alive: bool = True
) -> list[Step]:
    done = []
    for k in range(first, first + count):
        if alive:
            plc.beat()
        done.append(await service.step(float(k)))
        await asyncio.sleep(1.0 / SPEED)
    return done


def service_for(site: Site, plc: Plc, *, write: bool) -> CompensateService:
    return CompensateService(site.with_device("plc", port=plc.port), "FC101", write=write)


@pytest.mark.slow
async def test_it_writes_op_bumplessly_inside_its_limits_and_stops_when_told(
    tmp_path: Path,
) -> None:
    site = make_site(tmp_path)
    async with served(site) as plc:
        service = service_for(site, plc, write=True)
        await service.open()
        plc.enable(False)
        plc.send_block()
        off = await steps(service, plc, 0, 5)
        assert {step.verdict for step in off} == {Verdict.NO_MODEL}
        # What was committed while it was forbidden stays refused.
        plc.enable(True)
        plc.send_block(seq=2)
        on = await steps(service, plc, 5, 150)
        written = [step for step in on if step.verdict is Verdict.WRITTEN]
        assert len(written) > 45
        assert written[0].op == pytest.approx(written[0].op_before)
        assert all(20.0 <= step.op <= 80.0 for step in written)
        assert all(abs(step.op - step.op_before) <= 3.0 + 1e-4 for step in written)
        assert max(step.op for step in written) > 55.0  # beyond fS: the valve is being moved
        assert service.writes_done == len(written)
        plc.enable(False)
        after = await steps(service, plc, 155, 10)
        assert {step.verdict for step in after} == {Verdict.PLC_DISABLED}
        assert service.writes_done == len(written)
        plc.enable(True)
        again = await steps(service, plc, 165, 12)
        assert again[-1].verdict is Verdict.WRITTEN
        dead = await steps(service, plc, 177, 14, alive=False)
        assert dead[-1].verdict is Verdict.NO_MODEL
        assert "heartbeat" in dead[-1].detail
        plc.image.write(Table.HOLDING, 6, [0])  # the operator takes the loop to manual
        manual = await steps(service, plc, 191, 4)
        assert manual[-1].verdict is Verdict.MANUAL
        assert math.isnan(manual[-1].op)
        await service.close()


@pytest.mark.parametrize(
    ("enabled", "write", "verdict"),
    [(True, False, Verdict.DRY_RUN), (False, True, Verdict.NOT_ENABLED)],
)
async def test_nothing_is_written_unless_site_file_and_run_both_allow_it(
    tmp_path: Path, enabled: bool, write: bool, verdict: Verdict
) -> None:
    site = make_site(tmp_path, enabled=enabled)
    async with served(site) as plc:
        service = service_for(site, plc, write=write)
        plc.send_block()
        plc.enable(True)
        before = plc.op
        done = await steps(service, plc, 0, 80)
        assert done[-1].verdict is verdict
        assert math.isfinite(done[-1].op)
        assert plc.op == before
        assert service.writes_done == 0
        await service.close()


async def test_a_block_that_the_plc_has_refused_is_not_used(tmp_path: Path) -> None:
    """The PLC's own limits are known to it alone: nothing is written on a model it has refused."""
    site = make_site(tmp_path, limits="limits = { stick_band = [0.1, 0.2] }\n")
    async with served(site) as plc:
        service = service_for(site, plc, write=True)
        await service.open()
        plc.enable(True)
        plc.send_block()
        done = await steps(service, plc, 0, 80)
        assert plc.image.read(Table.HOLDING, AREA.ack_result, 1) == [11]
        assert {step.verdict for step in done} == {Verdict.NO_MODEL}
        assert service.writes_done == 0
        await service.close()


async def test_a_plc_that_forgot_its_blocks_says_again_what_is_newer(tmp_path: Path) -> None:
    """After a restart without RETAIN the PLC accepts any number, and so does the compensator."""
    site = make_site(tmp_path)
    async with served(site) as plc:
        port = plc.port
        service = service_for(site, plc, write=False)
        plc.enable(True)
        plc.send_block(seq=7)
        before = await steps(service, plc, 0, 8)
    async with served(site, port) as plc:
        empty = await steps(service, plc, 8, 20)
        plc.enable(True)
        plc.send_block(seq=1)
        after = await steps(service, plc, 28, 8)
        await service.close()
    assert before[-1].verdict is Verdict.WAITING
    assert empty[-1].verdict is Verdict.NO_MODEL
    assert after[-1].verdict is Verdict.WAITING


@pytest.mark.parametrize("age", [86_400.0, 50_000.0])
async def test_a_block_does_not_begin_anew_when_the_compensator_does(
    tmp_path: Path, age: float
) -> None:
    """A block expires ``valid_for`` seconds after the PLC took it, whatever starts again."""
    site = make_site(tmp_path)
    async with served(site) as plc:
        service = service_for(site, plc, write=False)
        plc.enable(True)
        plc.send_block(age=age)
        done = await steps(service, plc, 0, 8)
        expired = age >= 86_400.0
        assert (done[-1].verdict is Verdict.NO_MODEL) is expired
        if expired:
            assert "older than its valid-for time" in done[-1].detail
        await service.close()


async def test_after_a_long_silence_the_plcs_own_controller_has_the_loop_first(
    tmp_path: Path,
) -> None:
    """What it did with the stem meanwhile is not known: OP must not go on from then."""
    site = make_site(tmp_path)
    async with served(site) as plc:
        service = service_for(site, plc, write=False)
        plc.enable(True)
        plc.send_block()
        before = await steps(service, plc, 0, 90)
        assert before[-1].verdict is Verdict.DRY_RUN
        short = await steps(service, plc, 95, 2)
        assert {step.verdict for step in short} == {Verdict.DRY_RUN}
        # Its heartbeat is alive: the heartbeat's own time-out is not what gives the loop back.
        plc.beat()
        after = await steps(service, plc, 97 + 40, 60)
        verdicts = [step.verdict for step in after]
        assert Verdict.DRY_RUN not in verdicts[:3]
        assert Verdict.WAITING in verdicts[:3]
        taken = next(step for step in after if step.verdict is Verdict.DRY_RUN)
        assert taken.op == pytest.approx(taken.op_before)
        await service.close()


async def test_a_plc_that_does_not_take_op_is_named_and_the_model_is_not_blamed(
    tmp_path: Path,
) -> None:
    """A switch in the PLC that stands elsewhere is no reason to refuse the model for hours."""
    make_site(tmp_path)
    path = tmp_path / "site.toml"
    (tmp_path / "map.csv").write_text(
        MAP.format(writable="yes") + "FC101.OPX,holding,20,float32,0,100,yes\n"
    )
    path.write_text(path.read_text().replace('op_out = "FC101.OP"', 'op_out = "FC101.OPX"'))
    site, told = load_site(path), list[str]()
    async with served(site) as plc:
        site = site.with_device("plc", port=plc.port)
        service = CompensateService(site, "FC101", write=True, tell=told.append)
        await service.open()
        plc.enable(True)
        plc.send_block()
        done = await steps(service, plc, 0, 150)
        await service.close()
    assert service.writes_done > 0
    assert done[-1].verdict is Verdict.WAITING
    assert "OP does not follow what is written to FC101.OPX" in done[-1].detail
    assert len(told) == 1
    assert service.supervisor.memory.given_up == ()


async def test_one_process_writes_op_of_a_loop_and_a_dry_run_may_look_on(tmp_path: Path) -> None:
    site = make_site(tmp_path)
    first = CompensateService(site, "FC101", write=True)
    await first.open()
    second = CompensateService(site, "FC101", write=True)
    with pytest.raises(MemoryFileError, match="another process compensates this loop already"):
        await second.open()
    look = CompensateService(site, "FC101", write=False)
    await look.open()
    await look.close()
    await first.close()
    await second.open()
    await second.close()


def test_an_op_tag_that_the_map_does_not_call_writable_is_refused(tmp_path: Path) -> None:
    site = make_site(tmp_path)
    (tmp_path / "map.csv").write_text(MAP.format(writable="no"))
    plain = (tmp_path / "site.toml").read_text().split("[loops.FC101.plant]")[0]
    (tmp_path / "site.toml").write_text(plain)
    with pytest.raises(SiteError, match=r"FC101.OP is not writable in the register map"):
        load_site(tmp_path / "site.toml")
    (tmp_path / "map.csv").write_text(MAP.format(writable="yes"))
    site = load_site(tmp_path / "site.toml")
    with pytest.raises(CompensateError, match="no loop 'FC9'"):
        CompensateService(site, "FC9")


def test_bad_tables_are_refused_with_the_remedy(tmp_path: Path) -> None:
    make_site(tmp_path)
    path = tmp_path / "site.toml"
    good = path.read_text()
    path.write_text(good.replace('op_out = "FC101.OP"\n', ""))
    with pytest.raises(Exception, match="enabled = true needs op_out"):
        load_site(path)
    path.write_text(good.replace("low = 20.0", "low = 90.0"))
    with pytest.raises(Exception, match="low = 90 is not below high = 80"):
        load_site(path)
    for owned, role in (("FC101.SP", "sp"), ("FC101.PV", "pv"), ("FC101.VIEW", "mode")):
        rows = MAP.format(writable="yes").replace("FC101.PV,holding,2,float32,,,", PV_ROW)
        rows = rows.replace("4,float32,0,100,", "4,float32,0,100,yes")
        (tmp_path / "map.csv").write_text(rows + "FC101.VIEW,holding,6,uint16,,,yes\n")
        path.write_text(good.replace('op_out = "FC101.OP"', f'op_out = "{owned}"'))
        with pytest.raises(SiteError, match=f"{owned} is the {role} of this loop: OP would be"):
            load_site(path)
    path.write_text(good + SECOND_LOOP)
    with pytest.raises(SiteError, match=r"FC101.OP is the op_out of loop FC102: OP would be"):
        load_site(path)
    path.write_text(good.replace("high = 80.0", "high = 120.0"))
    with pytest.raises(
        SiteError, match=r"OP could not be written to FC101.OP: 120 is above the high limit"
    ):
        load_site(path)
