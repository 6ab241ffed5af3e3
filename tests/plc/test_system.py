"""A system of FMUs (SSP) behind a loop of the simulated PLC: one line of the site file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fieldlink.lab.plc import VirtualPlc
from fieldlink.site import Site
from fmu_models.example_system import build_example_system

MakeSite = Callable[..., Site]


def test_the_example_system_is_served(make_site: MakeSite, tmp_path: Path) -> None:
    build_example_system(tmp_path)
    plant = """\
fmu = "loop.ssp"
controller = "fmu"
setpoint = [[0.0, 50.0]]
variables = { op = "op", pv = "pv", stem = "stem", sp = "sp" }
"""
    inside = """\
fmu = "example1"
controller = "fmu"
setpoint = [[0.0, 50.0]]
parameters = { noise_std = 0.0, op_start = 40.0 }
"""
    truths = []
    for table in (plant, inside):
        with VirtualPlc(make_site(plant=table), "plc") as plc:
            for _ in range(120):
                plc.scan()
            assert not plc.failures
            truths.append(plc.truth("FC101"))
    system, one = truths
    for name in ("op", "pv", "stem"):
        np.testing.assert_allclose(getattr(system, name), getattr(one, name), rtol=1e-12)
    assert np.ptp(one.op) > 5.0
