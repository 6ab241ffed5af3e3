"""What a user can cause is one sentence; what is our defect keeps its traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from estimator import EstimatorError
from fieldlink.cli.errors import explain
from fieldlink.errors import FieldlinkError
from fmu_models import PlantError
from tests.cli.conftest import Run


def test_a_library_that_is_not_installed_is_named_with_its_extra(
    capsys: pytest.CaptureFixture[str],
) -> None:
    missing = ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
    assert explain(missing)
    assert capsys.readouterr().err.strip() == (
        "fieldlink: this command needs matplotlib, which is not installed; install it with "
        "pip install 'fieldlink[plot]'"
    )


def test_a_defect_of_ours_is_not_explained_away(capsys: pytest.CaptureFixture[str]) -> None:
    assert not explain(ModuleNotFoundError("No module named 'fieldlnk'", name="fieldlnk"))
    assert not explain(KeyError("op"))
    assert explain(FieldlinkError("loop FC1: it has no PV"))
    assert capsys.readouterr().err == "fieldlink: loop FC1: it has no PV\n"


def test_errors_of_packages_that_are_loaded_are_explained(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert explain(EstimatorError("too few samples"))
    assert explain(PlantError("it has ended"))
    said = capsys.readouterr().err
    assert said == "fieldlink: too few samples\nfieldlink: it has ended\n"


def loaded_by(code: str, *, among: set[str]) -> set[str]:
    """Return which of some modules a new process holds after ``code``."""
    code += f"\nimport sys; print(*({among!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_a_refusal_and_the_run_of_an_fmu_load_no_numerics_that_they_do_not_use() -> None:
    code = (
        "import fieldlink.lab.fmu\n"
        "from fieldlink.cli.errors import explain\n"
        "from fieldlink.errors import FieldlinkError\n"
        "assert explain(FieldlinkError('no'))\n"
    )
    assert not loaded_by(code, among={"compensator", "estimator", "numba", "scipy.signal"})


def test_neither_estimator_nor_compensator_loads_what_takes_longer_than_itself() -> None:
    """Every worker of a daemon, every command and a PLC's simulation begins with them."""
    code = "import compensator, estimator.diagnosis, fieldlink.lab.plc"
    slow = {"casadi", "matplotlib", "pandas", "scipy.optimize", "scipy.signal", "scipy.stats"}
    assert not loaded_by(code, among=slow)


NOWHERE = f"{'x' * 300}/"
"""The system refuses even to look, for anybody: as in a folder that is closed to this user."""


@pytest.mark.parametrize(
    "typed",
    [
        ["identify", NOWHERE + "a.csv"],
        ["diagnose", NOWHERE + "a.csv"],
        ["assess", NOWHERE + "a.csv"],
        ["report", NOWHERE + "a.csv"],
        ["report", NOWHERE + "a.sqlite"],
        ["web", NOWHERE + "a.sqlite"],
        ["check", NOWHERE + "a.toml"],
        ["rehearse", NOWHERE + "a.toml"],
        ["fmu", "info", NOWHERE + "a.fmu"],
        ["fmu", "run", NOWHERE + "a.fmu"],
        ["fmu", "sweep", NOWHERE + "a.fmu", "--out", "a.csv"],
        ["init", "map.csv", "--yes", "--out", NOWHERE + "a.toml"],
        ["map", "import", "map.csv", "--out", NOWHERE + "a.csv"],
        ["scan", "127.0.0.1:1", "--out", NOWHERE + "a.csv"],
    ],
    ids=lambda typed: " ".join(typed[:-1])[:20],
)
def test_a_path_that_may_not_be_looked_at_is_a_message(
    fieldlink: Run, tmp_path: Path, typed: list[str]
) -> None:
    (tmp_path / "map.csv").write_text("tag,address,type\nFC1.OP,0,float32\nFC1.PV,2,float32\n")
    done = fieldlink(*typed)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("fieldlink: ")
