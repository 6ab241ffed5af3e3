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

HASWELL = "+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse3,+sse4.1,+sse4.2,+ssse3"


def _features() -> dict[str, bool]:
    """What NumPy finds in this processor."""
    return dict(np._core._multiarray_umath.__cpu_features__)


def _dispatched(first: str) -> str:
    """NumPy's optional instruction sets from ``first`` on that this processor has."""
    names = list(np._core._multiarray_umath.__cpu_dispatch__)
    begin = names.index(first) if first in names else len(names)
    return " ".join(name for name in names[begin:] if _features()[name])


SETTINGS = {
    "numba generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "numba haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": HASWELL},
    "blas prescott, numpy baseline": {
        "OPENBLAS_CORETYPE": "Prescott",
        "OPENBLAS_NUM_THREADS": "1",
        "NPY_DISABLE_CPU_FEATURES": _dispatched("X86_V3"),
    },
    "blas haswell, numpy avx2": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": _dispatched("X86_V4"),
    },
    "blas skylake": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
NEEDED = {
    "numba haswell": "AVX2",
    "blas haswell, numpy avx2": "AVX2",
    "blas skylake": "AVX512F",
}
"""Instruction sets without which a setting cannot run."""


def _judged(windows: Path, folder: Path, settings: dict[str, str]) -> dict[str, Any]:
    """Verdict, score, S, J and their intervals (shares of OP's span) under some settings."""
    unset = ("NUMBA_", "OPENBLAS_", "NPY_")
    env = {name: value for name, value in os.environ.items() if not name.startswith(unset)}
    env |= {"NUMBA_CACHE_DIR": str(folder)} | settings
    done = subprocess.run(
        [sys.executable, "-c", JUDGE, str(windows)],
        cwd=ROOT,
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
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
@pytest.mark.parametrize("name", SETTINGS)
def test_no_answer_hangs_on_the_processor(
    name: str, windows: Path, native: dict[str, Any], tmp_path: Path
) -> None:
    needed = NEEDED.get(name, "SSE2")
    if not _features().get(needed, False):
        pytest.skip(f"this processor has no {needed}")
    settings = SETTINGS[name]
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
