"""The command line, run as a user runs it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from loop_model import ProcessModel, ValveModel
from tests.cli.typed import run_typed

Run = Callable[..., subprocess.CompletedProcess[str]]
SCRIPT = Path(sys.executable).with_name("fieldlink")


@pytest.fixture
def script(tmp_path: Path) -> Run:
    """Run the installed ``fieldlink ARGUMENTS`` in an empty folder, in a process of its own."""

    def run(*arguments: str | Path, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(SCRIPT), *map(str, arguments)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    return run


@pytest.fixture
def fieldlink(tmp_path: Path) -> Run:
    """Run ``fieldlink ARGUMENTS`` in an empty folder, in this process."""
    return partial(run_typed, tmp_path)


def limit_cycle(rows: int = 600) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """OP and PV of a lag under PI control behind a valve with S = 4 and J = 2, four set-points."""
    valve = ValveModel(stick_band=4.0, slip_jump=2.0)
    process = ProcessModel(a=(-0.9,), b=(0.1,), dead_time=1, offset=0.0, period=1.0)
    rng = np.random.default_rng(7)
    op, pv = np.empty(rows), np.empty(rows)
    stem, y, integral = 0.0, 0.0, 0.0
    for k in range(rows):
        error = (1.3, 2.1, 0.6, 1.7)[k // 150 % 4] - y
        integral += 0.06 * error
        op[k], pv[k] = 0.6 * error + integral, y + 0.02 * rng.standard_normal()
        stem = valve.step(stem, op[k])
        y = -process.a[0] * y + process.b[0] * stem
    return op, pv


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recorded limit cycle as a CSV file."""
    op, pv = limit_cycle()
    path = tmp_path / "loop.csv"
    rows = (f"{u:.6f},{y:.6f}" for u, y in zip(op, pv, strict=True))
    path.write_text("\n".join(["op,pv", *rows]) + "\n")
    return path
