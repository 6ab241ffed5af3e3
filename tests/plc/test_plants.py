"""Many FMUs in one PLC: one that hangs or crashes delays no other."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from pymodbus.client import AsyncModbusTcpClient

from fieldlink.daemon import LockstepRun
from fieldlink.lab.plc import HostedPlant, VirtualPlc, serve
from fieldlink.lab.plc.plants import step_all
from fieldlink.registers import DataType, Table, decode
from fieldlink.site import Site, load_site
from fieldlink.store import EventRecord, Record
from fmu_models import PlantCrashError, PlantInfo, catalogue
from fmu_models.packing import build_source

SOURCES = Path(__file__).parents[1] / "fmu_models" / "sources"

DEVICE = """\
[site]
name = "many"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5020
register_map = "map.csv"
{device}
"""
LOOP = """\
[loops.{name}]
device = "plc"
op = "{name}.OP"
pv = "{name}.PV"
mode = "{name}.MODE"
scan = "{name}.SCAN"
period = 1.0
[loops.{name}.plant]
{plant}
"""
ROWS = """\
{name}.OP,holding,{op},float32,yes
{name}.PV,holding,{pv},float32,
{name}.MODE,holding,{mode},uint16,
{name}.SCAN,holding,{scan},uint32,
"""

MakeMany = Callable[..., Site]


@pytest.fixture
def make_many(tmp_path: Path) -> MakeMany:
    """Write a site with a PLC of several loops, ten registers each, and load it."""

    def make(plants: Mapping[str, str], *, device: str = "") -> Site:
        loops = "".join(LOOP.format(name=name, plant=text) for name, text in plants.items())
        tags = "".join(
            ROWS.format(name=name, op=10 * k, pv=10 * k + 2, mode=10 * k + 4, scan=10 * k + 5)
            for k, name in enumerate(plants)
        )
        (tmp_path / "map.csv").write_text(f"tag,table,address,type,writable\n{tags}")
        path = tmp_path / "site.toml"
        path.write_text(DEVICE.format(device=device) + loops)
        return load_site(path)

    return make


def real(plc: VirtualPlc, address: int) -> float:
    return float(decode(plc.image.read(Table.HOLDING, address, 2), DataType.FLOAT32))


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A plant that can be told to hang, as a path for a site file."""
    built = build_source(SOURCES / "faulty.c", output=tmp_path_factory.mktemp("faulty"))
    return built[1].as_posix()


class SlowPlant:
    """A plant in the background that answers when the test lets it."""

    info = PlantInfo("slow", "3.0", "co-simulation", 1.0, ("op",), (), ("pv",), (), False)

    def __init__(self) -> None:
        self.begun: list[dict[str, float]] = []
        self.waits: list[float] = []
        self.answers = False
        self.fails = False

    def outputs(self) -> dict[str, float]:
        return {"pv": 0.0}

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        raise AssertionError(f"a plant in the background is stepped in the foreground: {inputs}")

    def begin_step(self, inputs: Mapping[str, float]) -> None:
        self.begun.append(dict(inputs))

    def finish_step(self, wait: float) -> dict[str, float] | None:
        self.waits.append(wait)
        if self.fails:
            raise PlantCrashError("it died")
        return {"pv": float(len(self.begun))} if self.answers else None

    def close(self) -> None:
        pass


def test_a_late_plant_is_waited_for_once_and_taken_up_when_it_answers() -> None:
    slow = SlowPlant()
    plant = HostedPlant(slow)
    plant.apply({"op": 1.0})
    step_all([plant], 0.01)
    assert plant.is_at_work
    step_all([plant], 0.01)
    step_all([plant], 0.01)
    assert len(slow.begun) == 1  # no step is begun over one that is not done
    assert len(slow.waits) == 1  # and nobody waits for it again
    slow.answers = True
    plant.finish(0.0)
    assert plant.is_fresh
    assert plant.values == {"pv": 1.0}
    plant.apply({"op": 2.0})
    step_all([plant], 0.01)
    assert slow.begun == [{"op": 1.0}, {"op": 2.0}]


def test_a_plant_of_two_loops_steps_once_a_scan() -> None:
    slow = SlowPlant()
    slow.answers = True
    plant = HostedPlant(slow)
    step_all([plant, plant], 1.0)
    assert len(slow.begun) == 1


def test_a_plant_that_dies_in_the_background_has_failed() -> None:
    slow = SlowPlant()
    plant = HostedPlant(slow)
    step_all([plant], 0.0)
    slow.fails = True
    plant.finish(0.0)
    assert str(plant.failure) == "it died"
    assert not plant.is_fresh
    assert not plant.is_at_work


def test_the_truth_of_a_plc_that_was_closed_at_a_step_can_be_read(make_many: MakeMany) -> None:
    site = make_many({"A": 'fmu = "example1"\ncontroller = "none"'})
    with VirtualPlc(site, "plc", patience=0.0) as plc:
        program = plc._loops["A"].program
        program.plant.close()
        program.plant = HostedPlant(SlowPlant())
        plc.scan()
    assert np.isnan(plc.truth("A").stem).tolist() == [True]


def test_a_stem_that_is_told_late_gets_into_the_truth(make_many: MakeMany) -> None:
    site = make_many({"A": 'fmu = "example1"\ncontroller = "none"\nparameters = { valve = 0 }'})
    with VirtualPlc(site, "plc", patience=0.0) as plc:
        for _ in range(20):
            plc.scan()
            plc._loops["A"].program.plant.finish(5.0)
        truth = plc.truth("A")
    assert truth.stem.tolist() == truth.op.tolist()


def test_a_late_cycle_shows_no_stale_pv_and_the_loop_goes_on(make_many: MakeMany) -> None:
    slow = SlowPlant()
    site = make_many({"A": 'fmu = "example1"\ncontroller = "none"'})
    with VirtualPlc(site, "plc", patience=0.0) as plc:
        program = plc._loops["A"].program
        program.plant.close()
        program.plant = HostedPlant(slow)
        plc.scan()
        plc.scan()
        assert np.isnan(real(plc, 2))
        assert plc.image.read(Table.HOLDING, 4, 1) == [1]  # the loop is still in automatic
        assert plc.late_cycles == {"A": 1}
        slow.answers = True
        plc.scan()
        assert real(plc, 2) == 1.0
        assert plc.failures == {}


@pytest.mark.slow
async def test_a_hanging_and_a_crashing_fmu_stall_nobody(make_many: MakeMany, faulty: str) -> None:
    bad = f'fmu = "{faulty}"\ncontroller = "none"\nparameters = {{ fault = '
    site = make_many(
        {
            "HANGS": bad + "3 }",
            "DIES": bad + "2 }",
            "LIVES": 'fmu = "example1"\ncontroller = "pi"\npi = { gain = 0.8, integral_time = 10 }',
        },
        device="speed = 20.0",
    )
    stop = asyncio.Event()
    ready: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(
        serve(site, port=0, ready=lambda servers: ready.set_result(servers[0].port), stop=stop)
    )
    await asyncio.wait({serving, ready}, return_when=asyncio.FIRST_COMPLETED)
    client = AsyncModbusTcpClient("127.0.0.1", port=ready.result(), timeout=60.0, retries=0)
    assert await client.connect()

    async def scans(loop: int) -> int:
        words = (await client.read_holding_registers(10 * loop + 5, count=2)).registers
        return int(decode(words, DataType.UINT32))

    try:
        async with asyncio.timeout(60.0):
            # Three seconds of the clock, well before the ten of the plant that hangs have passed.
            while await scans(2) < 60:
                await asyncio.sleep(0.05)
            hanging, dying, living = [
                decode(
                    (await client.read_holding_registers(address, count=2)).registers,
                    DataType.FLOAT32,
                )
                for address in (2, 12, 22)
            ]
        assert np.isnan(hanging)
        assert np.isnan(dying)
        assert np.isfinite(living)
    finally:
        client.close()
        stop.set()
        (server,) = await serving
    (unit,) = server.units
    assert list(unit.plc.failures) == ["DIES"]
    assert "SIGSEGV" in unit.plc.failures["DIES"]
    # its cycles go on; how punctual they are is the machine's load
    assert unit.plc.late_cycles["LIVES"] < unit.plc.late_cycles["HANGS"]
    assert unit.plc.late_cycles["HANGS"] > 50


TANKS = {
    "LC1": 'fmu = "fourtank"\ncontroller = "pi"\npi = { gain = 25.0, integral_time = 30.0 }\n'
    "setpoint = [[0, 12.4], [50, 13.4]]\nparameters = { valve1 = 0, valve2 = 0, op2 = 50.0 }",
    "LC2": 'of = "LC1"\ncontroller = "pi"\npi = { gain = 22.5, integral_time = 40.0 }',
}


def test_two_loops_of_one_fmu_see_each_other(make_many: MakeMany) -> None:
    """Johansson's tanks: water for tank 1 reaches tank 2 too, and that loop takes it back."""
    with VirtualPlc(make_many(TANKS), "plc") as plc:
        for _ in range(400):
            plc.scan()
        one, two = plc.truth("LC1"), plc.truth("LC2")
        assert plc._loops["LC1"].program.plant is plc._loops["LC2"].program.plant
    assert np.mean(one.pv[-50:]) == pytest.approx(13.4, abs=0.05)
    assert np.mean(two.pv[-50:]) == pytest.approx(np.mean(two.sp), abs=0.1)
    # The step of loop 1 pushes tank 2 up by its cross flow; loop 2 answers with less OP.
    assert np.max(two.pv[60:150]) > np.mean(two.sp) + 0.1
    assert np.mean(two.op[-50:]) < two.op[40] - 1.0


def test_a_controller_inside_the_fmu_is_shown_by_the_registers(make_many: MakeMany) -> None:
    inside = (
        'fmu = "flow"\ncontroller = "fmu"\nsetpoint = [[0, 50], [100, 60]]\n'
        "parameters = { valve = 0, pi_gain = 0.3, pi_time = 3.0 }"
    )
    with VirtualPlc(make_many({"FC": inside}), "plc") as plc:
        for _ in range(200):
            plc.scan()
        truth = plc.truth("FC")
        assert real(plc, 0) == np.float32(truth.op[-1])
        assert plc.image.read(Table.HOLDING, 4, 1) == [1]
    assert np.mean(truth.pv[60:100]) == pytest.approx(50.0, abs=0.5)
    assert np.mean(truth.pv[-40:]) == pytest.approx(60.0, abs=0.5)
    # The stem of a healthy valve is the OP that the FMU applied in that very step.
    np.testing.assert_allclose(truth.stem, truth.op)


async def test_a_plc_may_be_paced_by_its_plants(make_many: MakeMany) -> None:
    plant = 'fmu = "level"\ncontroller = "pi"\npi = { gain = 4.0, integral_time = 100.0 }'
    site = make_many({"LC": plant}, device='pace = "plant"')
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(0.5, stop.set)
    (server,) = await serve(site, port=0, stop=stop)
    (unit,) = server.units
    # By the clock it would be one.
    assert unit.plc.scans > 20
    assert unit.late == 0


def test_sixteen_fmus_run_in_one_plc(make_many: MakeMany) -> None:
    plant = 'fmu = "{}"\ncontroller = "pi"\npi = {{ gain = 0.1, integral_time = 50 }}\nseed = {}'
    names = [name for name, model in catalogue.items() if len(model.loops) == 1]
    plants = {f"L{k}": plant.format(names[k % len(names)], k) for k in range(16)}
    with VirtualPlc(make_many(plants), "plc") as plc:
        for _ in range(5):
            plc.scan()
        assert plc.failures == {}
        pids = {os.getpid()} | {
            plc._loops[loop].program.plant._plant._link._key for loop in plc.loops
        }
        assert len(pids) == 17
        assert all(np.isfinite(plc.truth(loop).pv).all() for loop in plc.loops)


def test_the_shipped_site_of_many_plants_runs() -> None:
    site = load_site(Path(__file__).parents[2] / "site_configs" / "plants.toml")
    with VirtualPlc(site, "plc") as plc:
        for _ in range(40):
            plc.scan()
        assert plc.failures == {}
        (status,) = plc.image.read(Table.HOLDING, 69, 1)
        truths = {loop: plc.truth(loop) for loop in plc.loops}
    assert status == 3  # nobody wrote OP of LC104 for 30 s: the PLC's own PI has it
    assert all(np.isfinite(truth.pv).all() and truth.automatic.all() for truth in truths.values())


async def test_a_run_in_lockstep_tells_of_each_plant_that_failed(
    make_many: MakeMany, faulty: str
) -> None:
    bad = f'fmu = "{faulty}"\ncontroller = "none"\nparameters = {{ fault = '
    site = make_many({"DIES": bad + "2 }", "REFUSES": bad + "4 }", "LIVES": bad + "0 }"})
    records: list[Record] = []
    run = LockstepRun(site.with_device("plc", link="fmu"), on_record=records.append)
    status = await run.run(10.0)
    told = [one for one in records if isinstance(one, EventRecord) and one.kind == "plant.failed"]
    assert all(one.message.endswith("; its loop stands still, the others go on") for one in told)
    dies, refuses = (one.message for one in told)
    assert "loop DIES: " in dies
    assert "SIGSEGV" in dies
    assert "loop REFUSES: " in refuses
    assert status.loops["LIVES"].counts.read == 10
