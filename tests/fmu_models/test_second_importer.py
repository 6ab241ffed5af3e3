"""Our plants in another importer than FMPy: Ecos, a C++ co-simulation engine."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmu_models import catalogue, fmu_path, open_plant
from fmu_models.example_system import build_example_system

_PROGRAM = """
import json, sys
from ecospy import EcosSimulation, EcosSimulationStructure
file, period, names, runs, inputs = json.loads(sys.argv[1])
tables = []
for parameters in runs:
    with EcosSimulationStructure() as structure:
        structure.add_model("plant", file)
        structure.add_parameter_set("start", {f"plant::{k}": v for k, v in parameters.items()})
        with EcosSimulation(structure=structure, step_size=period) as simulation:
            simulation.init(parameter_set="start")
            rows = []
            for row in inputs:
                for name, value in row.items():
                    simulation.set_real(f"plant::{name}", value)
                simulation.step()
                rows.append([simulation.get_real(f"plant::{name}") for name in names])
            simulation.terminate()
    tables.append(rows)
print("RESULT" + json.dumps(tables))
"""


def _missing() -> str | None:
    if importlib.util.find_spec("ecospy") is None:
        return "ecospy is not installed: pip install ecospy"
    done = subprocess.run(
        [sys.executable, "-c", "import ecospy"], capture_output=True, text=True, check=False
    )
    last = done.stderr.strip().splitlines()[-1:] or ["?"]
    return None if done.returncode == 0 else f"ecospy does not load (libtbb12?): {last[0]}"


@pytest.fixture(scope="module")
def ecos() -> None:
    why = _missing()
    if why is not None:
        pytest.skip(why)


@pytest.mark.usefixtures("ecos")
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", sorted(catalogue))
def test_ecos_and_fmpy_get_the_same_bits(name: str, version: int) -> None:
    model = catalogue[name]
    file = fmu_path(name, 2 if version == 2 else 3)
    loops = model.loops
    names = [signal for loop in loops for signal in (loop.pv, loop.stem, loop.op_out)]
    # Half of the time OP comes from outside, half of it from the controller inside.
    inside: dict[str, float] = {loop.controller: 1 for loop in loops}
    runs = ({"seed": 3}, {"seed": 4, **inside})
    inputs = [{loop.op: 40.0 + k % 9, loop.load: 0.5} for k in range(25) for loop in loops[:1]]
    request = [str(file), model.period, names, runs, inputs]
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, json.dumps(request)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    line = next(text for text in done.stdout.splitlines() if text.startswith("RESULT"))
    tables = json.loads(line.removeprefix("RESULT"))
    for parameters, rows in zip(runs, tables, strict=True):
        with open_plant(file, parameters=parameters, isolated=False) as plant:
            expected = [[row[signal] for signal in names] for row in plant.steps(inputs)]
        assert rows == expected


_SYSTEM_PROGRAM = """
import json, sys
from ecospy import EcosSimulation
file, count = json.loads(sys.argv[1])
with EcosSimulation(ssp_path=file, step_size=1.0) as simulation:
    simulation.init(parameter_set="start")
    rows = []
    for _ in range(count):
        simulation.step()
        rows.append([simulation.get_real(n) for n in
                     ("controller::op", "valve::stem", "process::pv")])
    simulation.terminate()
print("RESULT" + json.dumps(rows))
"""


@pytest.mark.usefixtures("ecos")
def test_a_system_under_our_jacobi_master_is_that_of_ecos(tmp_path: Path) -> None:
    """Ecos reads SSP, too; it knows no connectors of the system, so they are cut off."""
    whole, bare = build_example_system(tmp_path), tmp_path / "bare.ssp"
    with zipfile.ZipFile(whole) as source, zipfile.ZipFile(bare, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name.endswith(".ssd"):
                content = _without_system_connectors(content.decode()).encode()
            target.writestr(name, content)
    done = subprocess.run(
        [sys.executable, "-c", _SYSTEM_PROGRAM, json.dumps([str(bare), 100])],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    theirs = json.loads(done.stdout.split("RESULT")[1])
    with open_plant(bare, master="jacobi", isolated=False) as plant:
        ours = plant.run(100, {})
    names = ("controller.op", "valve.stem", "process.pv")
    assert [[float(ours[n][k]) for n in names] for k in range(100)] == theirs
    assert np.ptp(ours["valve.stem"]) > 5.0


def _without_system_connectors(text: str) -> str:
    """Cut off the system's connectors and their connections; the set-point is a start value."""
    text = re.sub(r'(<ssd:System name="loop">\n)<ssd:Connectors>.*?</ssd:Connectors>', r"\1",
                  text, flags=re.DOTALL)  # fmt: skip
    text = re.sub(r"<ssd:Connection start[^/]*/>", _keep_inner, text)
    sp = '<ssv:Parameter name="sp"><ssv:Real value="50"/></ssv:Parameter>'
    return text.replace("<ssv:Parameters>", f"<ssv:Parameters>{sp}", 1)


def _keep_inner(connection: re.Match[str]) -> str:
    whole = connection.group()
    return whole if "startElement" in whole and "endElement" in whole else ""
