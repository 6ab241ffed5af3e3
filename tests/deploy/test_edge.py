"""An edge box has no plants, pictures or brokers: what it needs works, the rest says so."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]

WITHOUT = """
import sys
for name in {names}:
    sys.modules[name] = None
sys.argv = ["fieldlink", *sys.argv[1:]]
from fieldlink.cli.app import main
main()
"""
OPTIONAL = ["fmpy", "lxml", "matplotlib", "fpdf", "casadi", "openpyxl", "pyarrow", "asyncua",
            "paho", "google.protobuf", "psycopg", "distributed", "ziglang"]  # fmt: skip


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = WITHOUT.format(names=OPTIONAL)
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_what_only_a_lab_needs_is_an_extra() -> None:
    always = {line.split(">")[0].split("[")[0] for line in PROJECT["dependencies"]}
    assert not always & set(OPTIONAL)
    assert {line.split(">")[0] for line in EXTRAS["lab"]} == {"fieldlink[plot]", "fmpy", "lxml"}


def test_an_edge_box_checks_its_site_and_is_told_what_the_demo_needs() -> None:
    checked = run("check", "site_configs/two_loops.toml")
    assert (checked.returncode, checked.stderr) == (0, "")
    assert "plants with an fmu are not checked here" in checked.stdout
    assert checked.stdout.rstrip().endswith("1 warning")
    told = run("demo")
    assert told.returncode == 2
    assert told.stderr == (
        "fieldlink: this command needs fmpy, which is not installed; install it with "
        "pip install 'fieldlink[lab]'\n"
    )


def test_every_data_file_of_the_adapter_goes_into_the_wheel() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    declared = {
        path
        for package, patterns in setuptools["package-data"].items()
        for pattern in patterns
        for path in (ROOT / package.replace(".", "/")).glob(pattern)
    }
    kept = {path for path in (ROOT / "fieldlink").rglob("*") if path.is_file()}
    data = {p for p in kept if p.suffix not in (".py", ".pyc") and p.name != "py.typed"}
    assert data - declared == set()
