"""The scripts of examples/ run and find what they say; talk_to_plc.py runs with the first loop."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from estimator import Verdict
from tests.docs.pages import ROOT


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_data_frame_gets_the_stem() -> None:
    example = load("identify_frame")
    frame = example.main(example.SHIPPED)
    # A stem with S = 4 and J = 1.5 rests most of the time, and OP never does.
    assert np.mean(np.diff(frame["stem"]) == 0.0) > 0.5
    assert np.mean(np.diff(frame["op"]) == 0.0) < 0.1


def test_an_fmu_in_the_loop_has_a_sticky_valve() -> None:
    found = load("fmu_in_the_loop").main("flow", 500)
    assert found.verdict is Verdict.STICTION
    assert found.stick_band.value == pytest.approx(4.0, rel=0.1)


def test_a_repair_is_seen_in_the_course_of_a_valve(tmp_path: Path) -> None:
    course = load("year_of_a_loop").main(["--weeks", "6", "--plot", str(tmp_path / "year.png")])
    assert np.asarray(course.stick_band.times).size == 6
    assert (tmp_path / "year.png").read_bytes().startswith(b"\x89PNG")


def test_the_paper_is_drawn_and_its_loop_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load("paper").main(["--out", str(tmp_path), "--data", str(ROOT.parent / "shared" / "data")])
    for name in ("figure2.png", "figure3.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    lines = capsys.readouterr().out.splitlines()
    figures = [re.search(r"by ([\d.]+), stem moves: (\d+)", s) for s in lines if "deviates" in s]
    (unaware, before), (aware, moves) = (map(float, f.groups()) for f in figures if f)
    # Noise makes most of PV here. Over twenty seeds: 0.44 to 0.96 of the deviation, on the mean
    # 0.67; at most a third of the moves. The seed that is drawn has 0.59 and none.
    assert aware < unaware
    assert moves <= 0.5 * before
    (chem,) = (i for i, line in enumerate(lines) if line.startswith("CHEM 10"))
    assert lines[chem] == "CHEM 10: stiction" or "is not there" in lines[chem]
