"""The same answers on every processor: recorded windows and the paper's examples.

Each setting is judged in a process of its own, which takes its instruction set from its
environment: Numba's kernels, OpenBLAS and NumPy's loops each have a switch. What a machine lacks is
skipped.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.examples import EXAMPLES, example_window
from benchmarks.processors import SETTINGS, lacking
from compiled import cache_folder

ROOT = Path(__file__).resolve().parents[2]

JUDGE = """
import json, sys
import numpy as np
from estimator import identify

windows = np.load(sys.argv[1])
found = {}
for name in windows:
    op, pv = windows[name]
    result = identify(op, pv)
    numbers = [
        getattr(interval, end)
        for interval in (result.stick_band, result.slip_jump)
        for end in ("value", "low", "high")
    ]
    found[name] = {
        "verdict": result.verdict.value,
        "uncertain": result.uncertain,
        "score": result.score,
        "numbers": [number / float(np.ptp(op)) for number in numbers],
    }
print(json.dumps(found))
"""


def _part(setting: str, *prefixes: str) -> dict[str, str]:
    """The variables of a setting that begin with one of the prefixes."""
    return {name: text for name, text in SETTINGS[setting].items() if name.startswith(prefixes)}


PARTS = {
    "numba generic": ("generic", _part("generic", "NUMBA_")),
    "numba haswell": ("haswell", _part("haswell", "NUMBA_")),
    "blas prescott, numpy baseline": (
        "generic",
        _part("generic", "OPENBLAS_", "NPY_") | {"OPENBLAS_NUM_THREADS": "1"},
    ),
    "blas haswell, numpy avx2": ("haswell", _part("haswell", "OPENBLAS_", "NPY_")),
    "blas skylake": ("skylakex", _part("skylakex", "OPENBLAS_")),
}
"""Settings taken apart, so that a difference names its library."""


def _said(program: str, settings: dict[str, str], *arguments: str) -> str:
    """What a program prints in a process of its own, under these settings and no others."""
    unset = ("NUMBA_", "OPENBLAS_", "NPY_")
    env = {name: value for name, value in os.environ.items() if not name.startswith(unset)}
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=ROOT,
        env=env | settings,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _judged(windows: Path, folder: Path, settings: dict[str, str]) -> dict[str, Any]:
    """Verdict, score, S, J and their intervals (shares of OP's span) under some settings."""
    settings = {"NUMBA_CACHE_DIR": str(folder)} | settings
    found: dict[str, Any] = json.loads(_said(JUDGE, settings, str(windows)))
    return found


def _recorded(path: Path) -> np.ndarray:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(row[name]) for row in rows] for name in ("op", "pv")])


@pytest.fixture(scope="module")
def windows(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """OP and PV by name: the same bits for every process, for a closed loop amplifies its own."""
    examples = {example.name: example_window(example, 0) for example in EXAMPLES}
    found = {name: np.stack([window.op, window.pv]) for name, window in examples.items()}
    for name in ("isdb/CHEM10.csv", "isdb/PAP2.csv", "plant/plant_02.csv", "plant/plant_14.csv"):
        found[name.partition("/")[2]] = _recorded(shared_data / name)
    path = tmp_path_factory.mktemp("windows") / "windows.npz"
    np.savez(path, **found)
    return path


@pytest.fixture(scope="module")
def native(windows: Path) -> dict[str, Any]:
    return _judged(windows, cache_folder().parent, {})


@pytest.mark.slow
@pytest.mark.timeout(900)  # kernels are compiled anew for two of the settings
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name.startswith("blas prescott") else pytest.mark.thorough)
        for name in PARTS
    ],
)
def test_no_answer_hangs_on_the_processor(
    name: str, windows: Path, native: dict[str, Any], tmp_path: Path
) -> None:
    setting, settings = PARTS[name]
    if (needed := lacking(setting)) is not None:
        pytest.skip(f"this processor has no {needed}")
    own_kernels = any(key.startswith("NUMBA_") for key in settings)
    found = _judged(windows, tmp_path if own_kernels else cache_folder().parent, settings)
    assert found.keys() == native.keys()
    for window, expected in native.items():
        for key in ("verdict", "uncertain"):
            assert found[window][key] == expected[key], window
    apart = {
        window: float(np.abs(np.array(found[window]["numbers"]) - expected["numbers"]).max())
        for window, expected in native.items()
    }
    assert {window: share for window, share in apart.items() if share > 1e-6} == {}


LOOP = """
from benchmarks.examples import EXAMPLES, example_window
import hashlib
for example in EXAMPLES:
    window = example_window(example, 7, samples=600)
    print(hashlib.sha256(window.op.tobytes() + window.pv.tobytes()).hexdigest())
"""


@pytest.mark.thorough
def test_a_loop_that_cycles_is_the_same_under_every_blas() -> None:
    """While a valve sticks, a last digit of the controller's gains grows to another slip."""
    cores = ("Prescott", "Haswell", *(["SkylakeX"] if lacking("skylakex") is None else []))
    assert len({_said(LOOP, {"OPENBLAS_CORETYPE": core}) for core in cores}) == 1
