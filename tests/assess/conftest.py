"""Recorded loops, and a folder of them as sites have it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks.examples import EXAMPLES, example_window
from benchmarks.families.tuning import draw
from fieldlink.assess.workers import watched
from tests.cli.typed import run_typed

UNREHEARSED = (
    sys.executable,
    "-c",
    "import estimator; estimator.warm_up = lambda: None; "
    "from fieldlink.assess.workers.worker import main; main()",
)
"""A worker that loads a kernel when a window needs it: rehearsing all of them takes three seconds
of a processor for each run that a test makes, and its windows are few."""


@contextmanager
def unrehearsed_workers() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watched, "PROCESS", UNREHEARSED)
        yield


@pytest.fixture(autouse=True, scope="module")
def _unrehearsed(request: pytest.FixtureRequest) -> Iterator[None]:
    """In all files but that about the workers themselves."""
    if request.path.name == "test_workers.py":
        yield
        return
    with unrehearsed_workers():
        yield


@dataclass(frozen=True)
class Recorded:
    """Samples a second apart."""

    op: np.ndarray
    pv: np.ndarray


@pytest.fixture(scope="session")
def sticky() -> Recorded:
    """A loop with a sticky valve, the paper's first, 400 samples."""
    loop = example_window(EXAMPLES[0], 1, samples=400)
    return Recorded(loop.op, loop.pv)


@pytest.fixture(scope="session")
def healthy() -> Recorded:
    """A loop with a healthy valve, 400 samples."""
    loop = draw("pi", sticky=False, seed=1)
    return Recorded(loop.op[:400], loop.pv[:400])


def write_csv(path: Path, loop: Recorded, *, separator: str = ",", comma: bool = False) -> None:
    """Write a recording as one of the dialects."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [separator.join(("Op", "PV"))]
    for op, pv in zip(loop.op.tolist(), loop.pv.tolist(), strict=True):
        cells = [repr(op), repr(pv)]
        lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="session")
def judged(tmp_path_factory: pytest.TempPathFactory, sticky: Recorded, healthy: Recorded) -> Path:
    """Four recordings in three dialects, one of them poisoned, and in ``out`` their table."""
    root = tmp_path_factory.mktemp("assess") / "loops"
    write_csv(root / "FC101.csv", sticky)
    write_csv(root / "area 2" / "TC202.csv", healthy, separator=";", comma=True)
    write_csv(root / "area 2" / "LC203.tsv", healthy, separator="\t")
    (root / "PC104.csv").write_text("op,pv\n" + "1.0,2.0\n" * 60 + "1.0,off\n")
    (root / "notes.txt").write_text("not a recording\n")
    # Inside what is read: the tables of a run are not recordings.
    with unrehearsed_workers():
        done = run_typed(root, "assess", root, "--out", root / "out", "--workers", 1)
    assert done.returncode == 1, done.stderr
    return root
