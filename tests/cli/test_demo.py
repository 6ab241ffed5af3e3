"""``fieldlink demo``: the chain from the plant to the compensator, over real Modbus TCP."""

from __future__ import annotations

import json
import multiprocessing
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.codegen import JITCPUCodegen as Codegen
from rich.console import Console

import compensator
import estimator.diagnosis
from fieldlink.cli import demo, kernels
from fieldlink.lab.demo import running
from fieldlink.lab.demo.outcome import Phase
from fieldlink.lab.demo.site_files import DemoError, simulated_scene
from fieldlink.lab.plc.truth import Truth
from tests.cli.conftest import SCRIPT, Run


def demonstrate(folder: Path, *options: str) -> dict[str, Any]:
    """Run a demonstration; return what it printed in the end."""
    command = [str(SCRIPT), "demo", *options, "--json", "--output", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_a_cycle_that_the_plant_was_late_for_hides_no_travel() -> None:
    """A busy machine: the PLC then knows neither PV nor stem, and goes on in the next cycle."""
    stem = np.array([1.0, 2.0, np.nan, 4.0, 3.0, 3.0])
    cycles, flags = np.arange(6), np.ones(6, dtype=bool)
    truth = Truth(cycles, stem, stem, stem, stem, flags, flags)
    phase = Phase.of(truth, 0, 6)
    assert (phase.valve_travel, phase.reversals) == (
        pytest.approx(100 * 4 / 6),
        pytest.approx(100 / 6),
    )
    unknown = Phase.of(replace(truth, stem=np.full(6, np.nan)), 0, 6)
    assert np.isnan([unknown.valve_travel, unknown.reversals]).all()


@pytest.mark.thorough
def test_a_recording_goes_through_real_registers(shared_data: Path, tmp_path: Path) -> None:
    # fewer rows in the same time: a busy machine reads them all
    rows = (shared_data / "isdb" / "CHEM10.csv").read_text().splitlines(keepends=True)[:601]
    (tmp_path / "CHEM10.csv").write_text("".join(rows))
    found = demonstrate(tmp_path / "demo", "--recording", str(tmp_path / "CHEM10.csv"))
    # Which scans are late decides which of two valves is a little likelier; the literature's S of
    # 1.70 to 1.85 lies in the interval of both.
    assert found["stick_band"]["low"] <= 1.85
    assert found["stick_band"]["high"] >= 1.70
    assert found["stick_band"]["value"] <= 2.1
    assert found["stick_band"]["true"] is None
    # The page shows what was read back from the holding registers.
    page = Path(found["report"]).read_text()
    row = re.search(r"<td>stick_band</td><td>([0-9.]+) OP</td>", page)
    assert row is not None
    assert float(row.group(1)) == pytest.approx(found["stick_band"]["value"], rel=1e-6)


def test_a_demo_that_comes_to_no_end_says_so_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(running, "PATIENCE", 1.0)
    with pytest.raises(DemoError, match=r"no parameter block .* within 1 s; .* try again"):
        running.perform(simulated_scene(tmp_path, seed=1), lambda _: None)
    assert multiprocessing.active_children() == []
    assert "Traceback" not in capfd.readouterr().err


def test_a_folder_that_cannot_be_written_is_named(fieldlink: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    result = fieldlink("demo", "--output", tmp_path / "file")
    assert result.returncode == 2
    assert f"{tmp_path / 'file'}" in result.stderr.replace("\n", "")
    assert "Traceback" not in result.stderr


def test_kernels_that_were_compiled_before_are_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        begun.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    for core in (estimator, estimator.diagnosis, compensator):
        monkeypatch.setattr(core, "warm_up", lambda: None)
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(demo.subprocess, "run", run)
    demo._load_kernels(Console())
    assert len(begun) == 1
    kernels.compile_kernels()
    demo._load_kernels(Console())
    assert len(begun) == 1
    # those of another processor are others
    monkeypatch.setattr(Codegen, "magic_tuple", lambda _: ("", "another", ""))
    demo._load_kernels(Console())
    assert len(begun) == 2


def test_a_recording_without_movement_is_refused(fieldlink: Run, tmp_path: Path) -> None:
    path = tmp_path / "still.csv"
    path.write_text("op,pv\n" + "".join(f"40,{50 + k % 7}\n" for k in range(200)))
    result = fieldlink("demo", "--recording", path)
    assert result.returncode == 2
    assert "OP does not change" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.waits
def test_the_oscillation_is_found_and_taken_away(tmp_path: Path) -> None:
    found = demonstrate(tmp_path)
    assert set(found) == {
        "stick_band",
        "slip_jump",
        "pv_std",
        "valve_travel",
        "reversals",
        "requests",
        "late_slots",
        "report",
        "page",
    }
    S = found["stick_band"]
    assert S["true"] == 11.0
    # The interval is one of 90 %, and when scans come decides which window it is of.
    assert S["value"] == pytest.approx(11.0, rel=0.05)  # as the scenario `compensated` asks
    assert S["low"] <= S["value"] <= S["high"]
    assert found["pv_std"]["ratio"] <= 0.35
    assert found["valve_travel"]["ratio"] <= 1.0
    assert found["requests"] > 1000
    page = Path(found["report"]).read_text()
    assert page.count("<svg") == 2
    assert "not searched" not in page
    # Opens without a network: nothing is fetched, no script runs.
    assert not re.search(r"<(script|link|img|iframe)|@import|url\((?!#)", page)
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"
