"""A model of one's own from the template, and a wheel that needs no compiler."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fmu_models import PlantBuildError, build, catalogue, open_plant, wheel
from fmu_models.template import new_model
from loop_model import ValveModel

ROOT = Path(__file__).parents[2]


def test_the_template_builds_and_runs_as_it_is(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["new", "my_tank", "--output", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "fill in what is marked with (1) to (6)" in done.output
    assert "NAME" not in (tmp_path / "my_tank.c").read_text()
    assert build.main([str(tmp_path / "my_tank.c"), "--output", str(tmp_path)]) == 0
    for version in (2, 3):
        assert validate_fmu(str(tmp_path / f"my_tank.fmi{version}.fmu")) == []
    op = 50.0 + 15.0 * np.sin(np.arange(120) / 8.0)
    with open_plant(tmp_path / "my_tank.fmi3.fmu", parameters={"noise_std": 0.0}) as plant:
        table = plant.run(120, {"op": op})
    stem = ValveModel(5.0, 2.0).simulate(op, 50.0)
    np.testing.assert_allclose(table["stem"], stem, atol=1e-12)
    temperature, expected = 50.0, []
    for position in stem:
        temperature += (position - temperature) * -np.expm1(-1.0 / 20.0)
        expected.append(temperature)
    np.testing.assert_allclose(table["pv"], expected, rtol=1e-12)
    shown = CliRunner().invoke(app, ["run", str(tmp_path / "my_tank.fmi2.fmu")])
    assert shown.exit_code == 0, shown.output


def test_names_and_files_that_are_refused(tmp_path: Path) -> None:
    for name in ("My-Tank", "1tank", "", "tänk", "a" * 40):
        with pytest.raises(PlantBuildError, match="cannot be the name of a model"):
            new_model(name, tmp_path)
    new_model("tank", tmp_path)
    with pytest.raises(PlantBuildError, match="it is there already"):
        new_model("tank", tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(PlantBuildError, match=r"cannot be written|there already"):
        new_model("tank", tmp_path / "file")


_NO_COMPILER = """
import sys
sys.modules["ziglang"] = None
import fmu_models
from fmu_models.compilers import PLATFORMS
from fmu_models.packing import is_current
assert fmu_models.__file__.startswith(sys.argv[1]), fmu_models.__file__
for name in fmu_models.catalogue:
    file = fmu_models.fmu_path(name)
    assert str(file).startswith(sys.argv[1])
    with fmu_models.open_plant(name, parameters={"seed": 5}) as plant:
        plant.run(20, {})
print(len(fmu_models.catalogue))
"""


@pytest.mark.thorough
def test_the_wheel_carries_the_plants_and_needs_no_compiler(tmp_path: Path) -> None:
    assert wheel.main(["--host-only", "--source", str(ROOT), "--output", str(tmp_path)]) == 0
    (built,) = tmp_path.glob("*.whl")
    assert built.name.endswith("-py3-none-any.whl")
    assert wheel.missing_plants(built) == []
    installed = tmp_path / "site"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", installed, built],
        check=True,
        capture_output=True,
    )
    for folder in installed.rglob("binaries"):  # nothing may be built: the folder is not writable
        folder.chmod(0o555)
    libraries = str(Path(fmpy.__file__).parents[1])
    environment = {k: v for k, v in os.environ.items() if k not in ("CC", "PYTHONPATH")}
    run = subprocess.run(
        [sys.executable, "-c", _NO_COMPILER, str(installed)],
        cwd=tmp_path,
        env=environment | {"PATH": "", "PYTHONPATH": os.pathsep.join((str(installed), libraries))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stdout.strip()) == (0, str(len(catalogue))), run.stderr


def test_a_wheel_without_plants_is_reported(tmp_path: Path) -> None:
    import zipfile

    empty = tmp_path / "fieldlink-0-py3-none-any.whl"
    with zipfile.ZipFile(empty, "w") as archive:
        archive.writestr("fmu_models/__init__.py", "")
    assert len(wheel.missing_plants(empty)) == 2 * len(catalogue)
