"""The PLC without a network: scans, tags, operators, failures, determinism."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fieldlink.lab.plc import PlcError, VirtualPlc
from fieldlink.lab.plc.image import ExceptionCode, RequestRefusedError
from fieldlink.lab.plc.truth import CycleRecord, TruthLog
from fieldlink.registers import DataType, Table, decode, encode
from fieldlink.site import Site, load_site
from fmu_models import catalogue

MakeSite = Callable[..., Site]

TWO_PERIODS = """\
[loops.LC2]
device = "plc"
op = "LC2.OP"
pv = "LC2.PV"
period = 2.5
[loops.LC2.plant]
recording = "tank.csv"
"""


def real(plc: VirtualPlc, address: int) -> float:
    return float(decode(plc.image.read(Table.HOLDING, address, 2), DataType.FLOAT32))


def test_registers_show_one_scan_of_the_loop(make_site: MakeSite) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        for _ in range(30):
            plc.scan()
        truth = plc.truth("FC101")
        assert real(plc, 0) == np.float32(truth.op[-1])
        assert real(plc, 2) == np.float32(truth.pv[-1])
        assert real(plc, 4) == 55.0
        assert plc.image.read(Table.HOLDING, 6, 3) == [1, 0, 30]
        assert plc.time == 30.0


def test_samples_obey_the_time_convention_of_the_models(make_site: MakeSite) -> None:
    # x_k is the stem under op_k, and PV of k + 1 follows from it: ARX on the recorded signals.
    noiseless = 'fmu = "example1"\nsetpoint = [[0.0, 70.0]]\nparameters = { noise_std = 0.0 }'
    with VirtualPlc(make_site(plant=noiseless), "plc") as plc:
        for _ in range(120):
            plc.scan()
        truth = plc.truth("FC101")
    model = catalogue["example1"]
    assert model.process is not None
    np.testing.assert_allclose(
        model.valve.simulate(truth.op, stem0=40.0), truth.stem, rtol=0, atol=1e-9
    )
    history = np.concatenate([np.full(5, 40.0), truth.stem])
    pv = model.process.simulate(history, pv0=(40.0, 40.0, 40.0))[5:]
    np.testing.assert_allclose(pv, truth.pv, atol=1e-9)


def test_an_unaware_controller_cycles_on_the_sticky_valve(make_site: MakeSite) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        for _ in range(900):
            plc.scan()
        truth = plc.truth("FC101")
    settled = slice(300, None)
    assert np.std(truth.pv[settled]) > 0.5  # 0.16 is what the noise alone makes
    assert np.mean(truth.pv[settled]) == pytest.approx(55.0, abs=0.5)
    assert not truth.compensated.any()


def test_a_healthy_valve_is_controlled_quietly(make_site: MakeSite) -> None:
    healthy = (
        'fmu = "example1"\nsetpoint = [[0.0, 55.0]]\nparameters = { valve = 0.0, noise_std = 0.01 }'
    )
    with VirtualPlc(make_site(plant=healthy), "plc") as plc:
        for _ in range(900):
            plc.scan()
        truth = plc.truth("FC101")
    assert np.std(truth.pv[300:]) < 0.2
    np.testing.assert_allclose(truth.stem, truth.op, atol=1e-12)


def test_pi_control_brings_pv_to_the_set_point(make_site: MakeSite) -> None:
    plant = (
        'fmu = "example1"\ncontroller = "pi"\npi = { gain = 0.6, integral_time = 9.0 }\n'
        "setpoint = [[0.0, 50.0], [20.0, 60.0]]\nparameters = { valve = 0.0, noise_std = 0.0 }"
    )
    with VirtualPlc(make_site(plant=plant), "plc") as plc:
        for _ in range(200):
            plc.scan()
        truth = plc.truth("FC101")
    assert truth.sp[19] == 50.0
    assert truth.sp[20] == 60.0
    assert truth.pv[-1] == pytest.approx(60.0, abs=0.01)


@pytest.mark.parametrize("isolated", [True, False])
def test_a_run_is_the_same_for_the_same_seed(make_site: MakeSite, isolated: bool) -> None:
    site = make_site()

    def run(seed: int) -> np.ndarray:
        plant = {**site.loops["FC101"].plant.model_dump(), "seed": seed}
        changed = site.with_loop("FC101", plant=plant)
        with VirtualPlc(changed, "plc", isolated=isolated) as plc:
            for _ in range(150):
                plc.scan()
            return plc.truth("FC101").pv

    first = run(1)
    np.testing.assert_array_equal(first, run(1))
    assert not np.array_equal(first, run(2))


def test_operator_in_manual_sets_op_and_goes_back_without_a_bump(make_site: MakeSite) -> None:
    registers = """\
tag,table,address,type,low,high,writable
FC101.OP,holding,0,float32,0,100,true
FC101.PV,holding,2,float32,,,
FC101.SP,holding,4,float32,0,100,true
FC101.MODE,holding,6,uint16,0,1,true
FC101.SCAN,holding,7,uint32,,,
"""
    with VirtualPlc(make_site(registers=registers), "plc") as plc:
        for _ in range(50):
            plc.scan()
        before = plc.truth("FC101").op[-1]
        plc.image.write(Table.HOLDING, 6, [0])
        plc.scan()
        assert plc.truth("FC101").op[-1] == np.float32(before)
        assert not plc.truth("FC101").automatic[-1]
        plc.image.write(Table.HOLDING, 0, encode(42.0, DataType.FLOAT32))
        for _ in range(80):
            plc.scan()
        assert set(plc.truth("FC101").op[-79:]) == {42.0}
        plc.image.write(Table.HOLDING, 4, encode(real(plc, 2), DataType.FLOAT32))
        plc.image.write(Table.HOLDING, 6, [1])
        plc.scan()
        assert plc.truth("FC101").automatic[-1]
        assert abs(plc.truth("FC101").op[-1] - 42.0) < 1.0


def test_an_operator_s_op_stays_inside_the_range(make_site: MakeSite) -> None:
    registers = (
        "tag,address,type,writable\nFC101.OP,0,float32,true\nFC101.PV,2,float32,\n"
        "FC101.SP,4,float32,\nFC101.MODE,6,uint16,\nFC101.SCAN,7,uint32,\n"
    )
    plant = 'fmu = "example1"\ncontroller = "none"'
    with VirtualPlc(make_site(plant=plant, registers=registers), "plc") as plc:
        assert real(plc, 0) == 40.0
        plc.image.write(Table.HOLDING, 0, encode(1e30, DataType.FLOAT32))
        plc.scan()
        assert real(plc, 0) == 100.0
        assert plc.image.read(Table.HOLDING, 6, 1) == [0]


@pytest.mark.parametrize(
    ("address", "value", "code"),
    [(4, 120.0, 3), (4, math.nan, 3), (0, 10.0, 2), (900, 1.0, 2)],
)
def test_writes_that_a_client_may_not_make(
    make_site: MakeSite, address: int, value: float, code: int
) -> None:
    registers = """\
tag,table,address,type,low,high,writable
FC101.OP,holding,0,float32,0,100,
FC101.PV,holding,2,float32,,,
FC101.SP,holding,4,float32,0,100,true
FC101.MODE,holding,6,uint16,,,
FC101.SCAN,holding,7,uint32,,,
"""
    with VirtualPlc(make_site(registers=registers), "plc") as plc:
        plc.scan()
        with pytest.raises(RequestRefusedError) as refused:
            plc.image.write(Table.HOLDING, address, encode(value, DataType.FLOAT32))
        assert refused.value.code is ExceptionCode(code)
        assert real(plc, 4) == 55.0


@pytest.mark.parametrize("word_order", ["big", "little"])
@pytest.mark.parametrize("byte_order", ["big", "little"])
def test_values_lie_in_the_device_s_order(
    make_site: MakeSite, word_order: str, byte_order: str
) -> None:
    orders = f'word_order = "{word_order}"\nbyte_order = "{byte_order}"'
    with VirtualPlc(make_site(device=orders), "plc") as plc:
        plc.scan()
        words = plc.image.read(Table.HOLDING, 4, 2)
    wire = b"".join(word.to_bytes(2, "big") for word in words)
    layout = {  # 55.0 is 0x425C0000
        ("big", "big"): "425c0000",
        ("little", "big"): "0000425c",
        ("big", "little"): "5c420000",
        ("little", "little"): "00005c42",
    }
    assert wire.hex() == layout[word_order, byte_order]


def test_integer_tags_saturate_and_the_counter_begins_again(make_site: MakeSite) -> None:
    registers = """\
tag,table,address,type,scale,offset
FC101.OP,input,0,uint16,0.01,
FC101.PV,input,1,int16,0.001,
FC101.SP,input,2,int16,0.1,-5
FC101.MODE,discrete,9,bool,,
FC101.SCAN,input,3,bool,,
"""
    with VirtualPlc(make_site(registers=registers), "plc") as plc:
        counts = []
        for _ in range(4):
            plc.scan()
            counts += plc.image.read(Table.INPUT, 3, 1)
        assert counts == [1, 0, 1, 0]
        op = plc.truth("FC101").op[-1]
        words = plc.image.read(Table.INPUT, 0, 3)
        assert words == [round(op / 0.01), 32767, 600]  # PV of 40 is more than 32.767
        assert plc.image.read(Table.DISCRETE, 9, 1) == [1]


def test_loops_of_different_periods_share_one_scan(make_site: MakeSite, tmp_path: Path) -> None:
    (tmp_path / "tank.csv").write_text("op,pv\n" + "".join(f"{k},{k / 10}\n" for k in range(60)))
    registers = (
        "tag,address,type\nFC101.OP,0,float32\nFC101.PV,2,float32\nFC101.SP,4,float32\n"
        "FC101.MODE,6,uint16\nFC101.SCAN,7,uint16\nLC2.OP,20,float32\nLC2.PV,22,float32\n"
    )
    with VirtualPlc(make_site(registers=registers, more=TWO_PERIODS), "plc") as plc:
        assert plc.scan_period == 0.5
        for _ in range(101):  # 0 s to 50 s
            plc.scan()
        assert plc.truth("FC101").pv.size == 51
        assert plc.truth("LC2").op.tolist() == list(range(21))


def test_a_crashed_plant_stops_its_loop_and_no_other(make_site: MakeSite, tmp_path: Path) -> None:
    (tmp_path / "tank.csv").write_text("op,pv\n" + "".join(f"{k},{k / 10}\n" for k in range(60)))
    registers = (
        "tag,address,type\nFC101.OP,0,float32\nFC101.PV,2,float32\nFC101.SP,4,float32\n"
        "FC101.MODE,6,uint16\nFC101.SCAN,7,uint16\nLC2.OP,20,float32\nLC2.PV,22,float32\n"
    )
    more = TWO_PERIODS.replace("2.5", "1.0")
    with VirtualPlc(make_site(registers=registers, more=more), "plc") as plc:
        for _ in range(3):
            plc.scan()
        plant = plc._loops["FC101"].program.plant._plant
        plant._link.kill()  # what a segfault does to the process of an FMU
        while not plc.failures:
            plc.scan()
        op, cycle = real(plc, 0), plc.scans
        for _ in range(5):
            plc.scan()
        assert list(plc.failures) == ["FC101"]
        assert re.fullmatch(
            r"loop FC101: plant .* its process died of SIGKILL.*",
            plc.failures["FC101"],
        )
        assert math.isnan(real(plc, 2))
        assert real(plc, 0) == op
        assert plc.image.read(Table.HOLDING, 6, 2) == [0, cycle + 5]  # manual; the PLC goes on
        assert real(plc, 20) == cycle + 4  # the row that the other loop plays


def test_a_plant_without_a_linear_model_needs_another_controller(make_site: MakeSite) -> None:
    site = make_site().with_loop("FC101", period=2.0)
    with pytest.raises(PlcError, match=r"FC101: controller = \"mpc\" needs a plant with a linear"):
        VirtualPlc(site, "plc")


def test_unknown_parameters_of_a_plant_are_named(make_site: MakeSite) -> None:
    plant = 'fmu = "example1"\nparameters = { noise_sdt = 0.1 }'
    with pytest.raises(PlcError, match=r"loop FC101: .*'noise_sdt'; did you mean 'noise_std'"):
        VirtualPlc(make_site(plant=plant), "plc")


def test_a_device_without_plants_cannot_be_simulated(make_site: MakeSite) -> None:
    site = make_site().with_loop("FC101", plant=None)
    with pytest.raises(PlcError, match="device plc: none of its loops has a plant; add a table"):
        VirtualPlc(site, "plc")


def test_the_truth_keeps_the_last_cycles_with_their_numbers() -> None:
    log = TruthLog(capacity=3)
    assert log.arrays().op.size == 0
    for k in range(5):
        log.add(CycleRecord(float(k), 10.0 + k, 0.0, math.nan, True, k == 4))
    truth = log.arrays()
    assert truth.cycle.tolist() == [2, 3, 4]
    assert truth.op.tolist() == [2.0, 3.0, 4.0]
    assert truth.compensated.tolist() == [False, False, True]


SHIPPED = Path(__file__).resolve().parents[2] / "site_configs"


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_site_that_is_simulated_runs(path: Path) -> None:
    site = load_site(path)
    simulated = {loop.device for loop in site.loops.values() if loop.plant is not None}
    if not simulated:
        pytest.skip(f"{path.name} describes no simulated PLC")
    for device in simulated:
        with VirtualPlc(site, device) as plc:
            for _ in range(50):
                plc.scan()
            assert not plc.failures
            for request in site.requests(device):
                plc.image.read(request.table, request.address, request.count)
