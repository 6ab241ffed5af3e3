"""The PLC in a process of its own: the same scans in batches, and a crash that is not ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fieldlink.lab.plc import BatchedPlc, PlcError, VirtualPlc
from fieldlink.registers import Table
from fieldlink.site import Site
from fmu_models.packing import build_source
from tests.plc.conftest import MAP

MakeSite = Callable[..., Site]
TAGS = ["FC101.OP", "FC101.PV", "FC101.SCAN"]


SLOW_LOOP = """
[loops.TC1]
device = "plc"
op = "TC1.OP"
pv = "TC1.PV"
period = 3.0
[loops.TC1.plant]
fmu = "example2"
controller = "pi"
pi = { gain = 0.5, integral_time = 20.0 }
seed = 4
setpoint = [[0.0, 50.0], [40.0, 55.0]]
"""
SLOW_TAGS = "TC1.OP,holding,20,int16,,,\nTC1.PV,input,4,float64,,,\n"


def test_a_batch_is_what_a_client_reads_after_every_scan(make_site: MakeSite) -> None:
    site = make_site(registers=MAP + SLOW_TAGS, more=SLOW_LOOP)
    names = [*TAGS, "FC101.SP", "FC101.MODE", "TC1.OP", "TC1.PV"]
    expected: dict[str, list[float]] = {tag: [] for tag in names}
    with VirtualPlc(site, "plc") as plc:
        for _ in range(300):
            plc.scan()
            for name in names:
                tag = site.maps["plc"][name]
                words = plc.image.read(tag.table, tag.address, tag.count)
                expected[name].append(tag.decode(words).value)
    with BatchedPlc(site, "plc") as batched:
        parts = [batched.record(count, names) for count in (1, 199, 100)]
        assert batched.scan_period == 1.0
        assert batched.failures() == {}
        image = {n: site.maps["plc"][n] for n in names}
        for name, tag in image.items():
            if tag.table is Table.HOLDING:
                left = tag.decode(batched.read(tag.table, tag.address, tag.count)).value
                assert left == expected[name][-1]
    for name in names:
        np.testing.assert_array_equal(np.concatenate([p[name] for p in parts]), expected[name])
    assert np.ptp(expected["FC101.PV"]) > 1.0
    assert np.ptp(expected["TC1.OP"]) >= 1.0


def test_writes_between_batches_and_refusals(make_site: MakeSite) -> None:
    registers = MAP.replace(
        "FC101.SP,holding,4,float32,0,100,", "FC101.SP,holding,4,float32,0,100,yes"
    )
    with BatchedPlc(make_site(registers=registers), "plc") as plc:
        plc.record(3, TAGS)
        plc.write(Table.HOLDING, 4, [0x4270, 0])  # SP = 60.0
        assert plc.record(2, ["FC101.SP"])["FC101.SP"].tolist() == [60.0, 60.0]
        assert plc.read(Table.HOLDING, 4, 2) == [0x4270, 0]
        with pytest.raises(PlcError, match="5000 does not exist"):
            plc.write(Table.HOLDING, 5000, [1])
        with pytest.raises(PlcError, match=r"no tag 'FC9.OP', it has FC101\.OP"):
            plc.record(1, ["FC9.OP"])
        assert plc.record(1, ["FC101.SCAN"])["FC101.SCAN"].tolist() == [6.0]


def test_a_crash_of_an_fmu_is_reported(make_site: MakeSite, tmp_path: Path) -> None:
    source = Path(__file__).parents[1] / "fmu_models" / "sources" / "faulty.c"
    fmu = build_source(source, output=tmp_path)[1]
    plant = f'fmu = "{fmu}"\ncontroller = "none"\nparameters = {{ fault = 2 }}\n'
    with (
        BatchedPlc(make_site(plant=plant), "plc") as plc,
        pytest.raises(PlcError, match="the PLC and its plants died of SIGSEGV"),
    ):
        plc.record(5, ["FC101.PV"])


def test_a_site_that_does_not_start_says_why(make_site: MakeSite) -> None:
    plant = 'fmu = "example1"\ncontroller = "none"\nparameters = { stick = 1 }\n'
    with pytest.raises(PlcError, match=r"loop FC101: .*did you mean"):
        BatchedPlc(make_site(plant=plant), "plc")
