"""``fieldlink check`` finds what a simulated PLC would refuse, with its line and key."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.lab.plc import check_plants
from fieldlink.site import SiteError, load_site
from fmu_models import fmu_path
from fmu_models.example_system import build_example_system
from tests.cli.typed import run_typed

SITES = Path(__file__).resolve().parents[2] / "site_configs"
PLANT = 'fmu = "example1"\n'


def make_site(folder: Path, plant: str = PLANT) -> Path:
    """The shipped site in lockstep with another plant."""
    for name in ("lockstep.toml", "demo.csv"):
        shutil.copy(SITES / name, folder)
    file = folder / "lockstep.toml"
    text = file.read_text()
    assert PLANT in text
    file.write_text(text.replace(PLANT, plant))
    return file


def no_zip(file: Path) -> None:
    file.write_text("this is no zip file")


def without_library(file: Path) -> None:
    with zipfile.ZipFile(fmu_path("example1")) as whole, zipfile.ZipFile(file, "w") as copy:
        for entry in whole.infolist():
            if not entry.filename.startswith("binaries/"):
                copy.writestr(entry, whole.read(entry))


def in_order(file: Path) -> None:
    shutil.copy(fmu_path("example1"), file)


@pytest.mark.parametrize("make", [None, in_order])
def test_what_can_run_passes(tmp_path: Path, make: Callable[[Path], None] | None) -> None:
    if make is None:
        plant = PLANT + "parameters = { stick_band = 5.0 }\n"
    else:
        make(tmp_path / "own.fmu")
        plant = 'fmu = "own.fmu"\npi = { gain = 0.5, integral_time = 10.0 }\n'
    file = make_site(tmp_path, plant)
    if make is not None:
        text = file.read_text().replace('controller = "mpc"', 'controller = "pi"')
        file.write_text(text)
    check_plants(load_site(file))


@pytest.mark.parametrize(
    ("plant", "make", "key", "said"),
    [
        ('fmu = "exampel1"\n', None, "fmu", "did you mean 'example1'"),
        ('fmu = "own.fmu"\n', no_zip, "fmu", "it is not an FMU (an FMU is a zip file)"),
        ('fmu = "own.fmu"\n', without_library, "fmu", "it has no library for this platform"),
        (PLANT + 'variables = { pv = "pvv" }\n', None, "variables.pv", "has no output 'pvv'"),
        (PLANT + "parameters = { stick = 5.0 }\n", None, "parameters.stick", "'stick_band'"),
        (
            PLANT + 'parameters = { stick_band = "wide" }\n',
            None,
            "parameters.stick_band",
            "must be a number",
        ),
        ('fmu = "flow"\n', None, "controller", "needs a plant with a linear model"),
    ],
)
def test_what_cannot_run_is_found_before_it_is_run(
    tmp_path: Path, plant: str, make: Callable[[Path], None] | None, key: str, said: str
) -> None:
    if make is not None:
        make(tmp_path / "own.fmu")
    file = make_site(tmp_path, plant)
    lines = file.read_text().splitlines()
    wanted = next(k for k, line in enumerate(lines, 1) if line.startswith(key.partition(".")[0]))
    checked = run_typed(tmp_path, "check", file)
    assert checked.returncode == 2
    assert f"lockstep.toml:{wanted}: loops.FC101.plant.{key}: " in checked.stderr
    assert said in checked.stderr
    # The run refuses the same.
    assert run_typed(tmp_path, "run", file, "--duration", 10).stderr == checked.stderr


def test_everything_is_reported_at_once(tmp_path: Path) -> None:
    variables = 'variables = { op = "opp", pv = "pvv" }\n'
    file = make_site(tmp_path, 'fmu = "flow"\n' + variables)
    with pytest.raises(SiteError) as caught:
        check_plants(load_site(file))
    keys = [problem.key.removeprefix("loops.FC101.plant.") for problem in caught.value.problems]
    assert sorted(keys) == ["controller", "variables.op", "variables.pv"]


def test_a_system_is_checked(tmp_path: Path) -> None:
    build_example_system(tmp_path)
    right = 'variables = { op = "op", pv = "pv", stem = "stem", sp = "sp" }\n'
    file = make_site(tmp_path, 'fmu = "loop.ssp"\n' + right)
    text = file.read_text().replace('controller = "mpc"', 'controller = "fmu"')
    file.write_text(text.replace("compensate = true\n", ""))
    check_plants(load_site(file))
    file.write_text(file.read_text().replace('sp = "sp" }', 'sp = "wanted" }'))
    with pytest.raises(SiteError, match=r"variables\.sp: .* has no input 'wanted' for sp"):
        check_plants(load_site(file))
