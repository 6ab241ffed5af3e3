"""Runs that end before their time keep what was computed; odd experiments simply run."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fieldlink.lab.fmu import FmuError
from fieldlink.lab.fmu.inputs import read_inputs

Odd = dict[str, Path]


def command(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


def plain(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("in_process", [(), ("--in-process",)])
def test_an_fmu_that_ends_its_simulation_has_not_failed(
    odd: Odd, tmp_path: Path, in_process: tuple[str, ...]
) -> None:
    out = tmp_path / "out.csv"
    done = command("run", odd["plain"], "--set", "stop_at=2", "--out", out, *in_process)
    assert done.exit_code == 0, done.output
    assert "ended in order at 2 s: plant odd: the FMU ended the simulation" in plain(done.output)
    assert pd.read_csv(out)["time"].tolist() == [0.25 * k for k in range(9)]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_failure_keeps_the_steps_before(
    mini_fmus: dict[str, Path], tmp_path: Path, suffix: str
) -> None:
    """The fault comes at 2 s; all ten steps are one batch."""
    mapping, inputs = tmp_path / "map.toml", tmp_path / "in.csv"
    mapping.write_text('[inputs.F]\nvariable = "fault"\n[outputs.H]\nvariable = "tank.h"\n')
    inputs.write_text("time,F,tank.inflow[1]\n0,0,2\n2,6,2\n")
    out = tmp_path / f"out.{suffix}"
    done = command(
        "run", mini_fmus["fmi2"], "--map", mapping, "--inputs", inputs, "--step", 1, "--out", out
    )
    assert isinstance(done.exception, FmuError)
    assert "it ended early, at 2 s: plant mini: output tank.h is nan at 3 s" in str(done.exception)
    table = pd.read_csv(out) if suffix == "csv" else pd.read_parquet(out)
    assert table["time"].tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_allclose(table["H"], 2.0 * (1.0 - np.exp(-table["time"])), atol=2e-3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.csv", "map.toml", out.name]


# A background job of a shell ignores Ctrl-C, and so would a program that the tests start in it.
_PROGRAM = """
import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("fieldlink.cli", run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("out", "growing", "number"),
    [("x.csv", "x.csv", signal.SIGINT), ("x.parquet", "x.parquet.partial.csv", signal.SIGKILL)],
)
def test_what_is_computed_is_on_the_disk_as_it_goes(
    faulty: Path, tmp_path: Path, out: str, growing: str, number: signal.Signals
) -> None:
    """Each step takes 0.3 s; Ctrl-C, or a kill, ends the program after some of them."""
    arguments = ["run", str(faulty), "--set", "fault=6", "--stop", "1000", "--out"]
    program = subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, "fmu", *arguments, str(tmp_path / out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    file, limit = tmp_path / growing, time.monotonic() + 60.0
    while not file.exists() or len(file.read_text().splitlines()) < 4:
        assert time.monotonic() < limit
        assert program.poll() is None
        time.sleep(0.05)
    program.send_signal(number)
    _said, complaint = program.communicate(timeout=300)
    assert ("it was interrupted" in complaint) == (number == signal.SIGINT)
    assert "Traceback" not in complaint
    table = pd.read_csv(file)
    assert table["steps"].tolist() == list(range(len(table)))
    assert len(table) >= 3


@pytest.mark.parametrize(
    ("key", "why"), [("long", "names no step"), ("long-own-step", "1e+08 steps")]
)
def test_an_experiment_of_years_simply_runs(odd: Odd, tmp_path: Path, key: str, why: str) -> None:
    out = tmp_path / "out.csv"
    done = command("run", odd[key], "--out", out)
    assert done.exit_code == 0, done.output
    assert why in plain(done.output)
    assert "so it takes 200000 s; choose another with --step" in plain(done.output)
    assert pd.read_csv(out)["time"].tolist() == [2e5 * k for k in range(501)]


def test_stop_that_is_no_multiple_of_the_step(odd: Odd, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    assert command("run", odd["plain"], "--stop", 0.6, "--out", out).exit_code == 0
    table = pd.read_csv(out)
    np.testing.assert_allclose(table["time"], [0.0, 0.25, 0.5, 0.6])
    np.testing.assert_allclose(table["x"], np.exp(-table["time"]), rtol=1e-9)
    fixed = command("run", odd["fixed"], "--stop", 0.6, "--out", out)
    assert fixed.exit_code == 0, fixed.output
    assert pd.read_csv(out)["time"].tolist() == [0.0, 0.25, 0.5]
    assert "steps of 0.25 s only, so the run ends at 0.5 s" in plain(fixed.output)


def test_arrays_words_feedthrough_and_a_variable_called_time(odd: Odd, tmp_path: Path) -> None:
    inputs, out = tmp_path / "in.csv", tmp_path / "out.csv"
    inputs.write_text("time,u[2],flag,mode\n0,3,true,fast\n0.5,4,FALSE,slow\n")
    done = command(
        "run", odd["plain"], "--inputs", inputs, "--set", "n=2", "--stop", 1, "--watch", "m",
        "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out)
    assert table["y[2]"].tolist() == [6.0, 6.0, 6.0, 8.0, 8.0]  # the first at once
    assert "y[3]" not in table
    assert table["flag"].tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert table["mode"].tolist() == [2.0, 2.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(table["m[2,3]"], 6.0 * table["x"])
    assert table["time"].tolist() == table["variable.time"].tolist()
    assert "the variable called time is the column variable.time" in plain(done.output)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("quick", r"row 3, column 'mode': 'quick' is not a finite number and none of slow, fast"),
        ("", r"row 3, column 'mode': an empty cell is not a finite number"),
    ],
)
def test_words_that_mean_nothing(tmp_path: Path, cell: str, words: str) -> None:
    file = tmp_path / "in.csv"
    file.write_text(f"time,mode\n0,slow\n1,{cell}\n")
    with pytest.raises(FmuError, match=words):
        read_inputs(file, ["mode"], {"mode": {"slow": 1.0, "fast": 2.0}})
