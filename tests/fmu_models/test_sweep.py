"""Sweeps: the same runs in any order and after an interruption, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fmu_models import PlantInputError, PlantNameError, Sweep, SweepRun, open_plant, run_sweep

PLAN = Sweep(
    "flow",
    steps=300,
    grid={"stick_band": (3.0, 6.0), "valve": (0.0, 1.0)},
    random={"noise_std": (0.05, 0.5)},
    fixed={"slip_jump": 1.0},
    runs=3,
)


def same(first: SweepRun, second: SweepRun) -> bool:
    return (
        (first.number, first.parameters, first.figures, first.error)
        == (second.number, second.parameters, second.figures, second.error)
    ) and all(np.array_equal(first.signals[k], second.signals[k]) for k in first.signals)


def test_a_run_is_the_plant_with_its_parameters() -> None:
    runs = list(run_sweep(PLAN, workers=0))
    assert [run.number for run in runs] == list(range(12))
    assert len({run.parameters["seed"] for run in runs}) == 12
    assert len({run.parameters["noise_std"] for run in runs}) == 12
    run = runs[7]
    assert (run.parameters["stick_band"], run.parameters["valve"]) == (6.0, 0.0)
    with open_plant("flow", parameters=run.parameters) as plant:
        rows = [plant.outputs(), *plant.steps([{}] * 300)]
    assert run.signals["pv"].tolist() == [row["pv"] for row in rows[:-1]]
    assert run.signals["op"].tolist() == [row["op_out"] for row in rows[1:]]
    assert run.signals["stem"].tolist() == [row["stem"] for row in rows[1:]]
    assert run.figures["pv_std"] == pytest.approx(run.signals["pv"][60:].std())
    assert set(run.signals["sp"]) == {63.0}


def test_a_sticky_valve_oscillates() -> None:
    plan = Sweep("example1", steps=900, grid={"valve": (0.0, 1.0)})
    healthy, sticky = run_sweep(plan, workers=0)
    assert sticky.figures["pv_std"] > 2.0 * healthy.figures["pv_std"]


def test_the_pool_gives_the_same() -> None:
    inline = list(run_sweep(PLAN, workers=0))
    seen: list[tuple[int, int]] = []
    pooled = list(run_sweep(PLAN, workers=2, progress=lambda *counts: seen.append(counts)))
    assert all(map(same, inline, pooled))
    assert seen[0] == (0, 12)
    assert seen[-1] == (12, 12)


def test_an_interrupted_sweep_goes_on(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    whole = list(run_sweep(PLAN, workers=0))
    interrupted = run_sweep(PLAN, workers=0, journal=journal)
    for _ in range(5):
        next(interrupted)
    interrupted.close()
    lines = journal.read_bytes()
    assert lines.count(b"\n") == 6  # the plan and five runs
    journal.write_bytes(lines + b'{"number": 5, "parame')  # killed in the middle of a line
    seen: list[int] = []
    rest = list(
        run_sweep(PLAN, workers=0, journal=journal, progress=lambda done, _: seen.append(done))
    )
    assert seen[0] == 5
    assert all(map(same, whole, rest))
    assert [json.loads(line)["number"] for line in journal.read_text().splitlines()[1:]] == [
        *range(12)
    ]


def test_a_run_that_the_plant_refuses_is_a_result() -> None:
    plan = Sweep("flow", steps=10, grid={"stick_band": (0.5, 3.0)})  # the default J is 1
    refused, fine = run_sweep(plan, workers=0)
    assert refused.error is not None
    assert "slip_jump must not exceed stick_band" in refused.error
    assert fine.error is None


def test_a_loop_of_several() -> None:
    plan = Sweep("fourtank", steps=50, grid={"stick_band2": (2.0, 5.0)}, loop=1)
    first, _second = run_sweep(plan, workers=0)
    with open_plant("fourtank", parameters=first.parameters) as plant:
        assert first.signals["stem"].tolist() == plant.run(50, {})["stem2"].tolist()


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"model": "flw"}, PlantNameError, "no plant 'flw'; did you mean 'flow'"),
        ({"steps": 0}, PlantInputError, "at least one step"),
        ({"grid": {"stick_band": ()}}, PlantInputError, "at least one finite value"),
        ({"random": {"stick_band": (2.0, 1.0)}}, PlantInputError, "low <= high"),
        ({"loop": 1}, PlantInputError, "flow has 1 loops; loop 1 is none"),
        (
            {"grid": {"valve": (1.0,)}, "fixed": {"valve": 0.0}},
            PlantInputError,
            "valve: given more than once",
        ),
        ({"fixed": {"stikband": 0.0}}, PlantNameError, "'stikband'.*did you mean 'stick_band'"),
    ],
)
def test_sweeps_that_are_refused(
    arguments: dict[str, object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        list(run_sweep(Sweep(**({"model": "flow", "steps": 5} | arguments)), workers=0))  # type: ignore[arg-type]


def test_journal_of_another_sweep(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    list(run_sweep(Sweep("flow", steps=5), workers=0, journal=journal))
    with pytest.raises(PlantInputError, match="journal of another sweep"):
        list(run_sweep(Sweep("flow", steps=6), workers=0, journal=journal))
    journal.write_text("hello\n")
    with pytest.raises(PlantInputError, match="is not the journal of a sweep"):
        list(run_sweep(Sweep("flow", steps=6), workers=0, journal=journal))


def test_any_fmu_with_parameters_by_name(odd: dict[str, Path]) -> None:
    """Structural sizes, grid and drawn values; x goes from 1 to gain u[1], by closed form."""
    plan = Sweep(
        str(odd["plain"]),
        steps=3,
        period=0.1,
        grid={"u[1]": (2.0, 3.0)},
        random={"gain": (1.0, 4.0)},
        fixed={"n": 2.0},
        runs=4,
        design="latin",
    )
    runs = list(run_sweep(plan, workers=0))
    assert [run.parameters["u[1]"] for run in runs] == [2.0] * 4 + [3.0] * 4
    for point in (runs[:4], runs[4:]):  # a Latin hypercube: one draw in each quarter of the range
        quarters = sorted(int((run.parameters["gain"] - 1.0) / 0.75) for run in point)
        assert quarters == [0, 1, 2, 3]
    for run in runs:
        goal = run.parameters["gain"] * run.parameters["u[1]"]
        x = goal + (1.0 - goal) * np.exp(-0.1 * np.arange(4))
        np.testing.assert_allclose(run.signals["x"], x, rtol=1e-9)
        assert run.figures["x_last"] == run.signals["x"][-1]
        assert run.figures["y[2]_max"] == 0.0
    pooled = list(run_sweep(plan, workers=3))
    assert all(map(same, runs, pooled))


def test_whole_numbers_are_drawn_whole(odd: dict[str, Path]) -> None:
    plan = Sweep(str(odd["plain"]), steps=1, random={"mode": (1.0, 2.0)}, runs=12)
    assert {run.parameters["mode"] for run in run_sweep(plan, workers=2)} == {1.0, 2.0}


def test_runs_that_crash_or_end_are_results(
    faulty: Path, odd: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out.csv"
    arguments = ["sweep", str(faulty), "--set", "fault=0,2,4", "--steps", "5", "--out", str(out)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 1
    assert "3 runs, 2 failed" in done.output
    assert (
        "run 1: plant faulty.fmi3.fmu at 0 s: in a step its process died of SIGSEGV" in done.output
    )
    assert "run 2: plant faulty: the step from 0 s by 1 s failed" in done.output
    table = pd.read_csv(out)
    assert table["steps_last"].tolist()[0] == 5.0
    assert table["error"].isna().tolist() == [True, False, False]
    ended = Sweep(str(odd["plain"]), steps=20, fixed={"stop_at": 0.6})
    (run,) = run_sweep(ended, workers=0)
    assert run.error is None
    assert run.ended is not None
    assert "ended the simulation at 0.6 s" in run.ended
    assert run.signals["x"].size == 4


def test_an_interrupted_sweep_of_any_fmu_goes_on(odd: dict[str, Path], tmp_path: Path) -> None:
    plan = Sweep(str(odd["plain"]), steps=2, grid={"gain": (1.0, 2.0, 3.0)})
    journal = tmp_path / "journal"
    begun = run_sweep(plan, workers=0, journal=journal)
    first = next(begun)
    begun.close()
    seen: list[int] = []
    rest = list(
        run_sweep(plan, workers=0, journal=journal, progress=lambda done, _: seen.append(done))
    )
    assert seen[0] == 1
    assert same(first, rest[0])
    with journal.open() as lines:
        assert sum(1 for _ in lines) == 4


def test_without_options_a_run_is_the_default_experiment(
    odd: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out.parquet"
    done = CliRunner().invoke(
        app, ["sweep", str(odd["plain"]), "--set", "gain=1,2", "--signals", "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert [len(x) for x in pd.read_parquet(out)["x"]] == [21, 21]


def test_command(tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    done = CliRunner().invoke(
        app,
        ["sweep", "level", "--set", "stick_band=2,4,6", "--set", "slip_jump=1", "--runs",
         "2", "--steps", "100", "--random", "noise_std=0.01:0.1", "--workers", "0", "--signals",
         "--out", str(out)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "6 runs, 0 failed" in done.output
    table = pd.read_parquet(out)
    assert table["stick_band"].tolist() == [2.0, 2.0, 4.0, 4.0, 6.0, 6.0]
    assert all(len(pv) == 100 for pv in table["pv"])
    assert [path.name for path in tmp_path.iterdir()] == ["out.parquet"]
