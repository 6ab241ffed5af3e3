"""``fieldlink simulate``: a study from the command line, its table, picture, JSON and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.lab.study.simulation import Simulation, SimulationError, simulate

RUN = CliRunner()


@pytest.mark.slow
def test_the_hybrid_beats_the_unaware_under_the_same_noise(tmp_path: Path) -> None:
    picture = tmp_path / "study.png"
    args = ["simulate", "example1", "--samples", "1000", "--plot", str(picture), "--json"]
    result = RUN.invoke(app, args)
    assert result.exit_code == 0, result.output
    found = {one["controller"]: one for one in json.loads(result.output)["controllers"]}
    assert found["hybrid"]["before"] == found["unaware"]["before"]
    assert found["hybrid"]["after"]["travel"] < found["unaware"]["after"]["travel"]
    assert found["hybrid"]["fell_back"] == ""
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_the_hybrid_keeps_pv_nearer_to_the_set_point_in_the_median_of_five_noises() -> None:
    """Rounding decides when the unaware loop's valve slips: one run of it tells little."""
    ratios = []
    for seed in range(1, 6):
        args = ["simulate", "example1", "--samples", "1000", "--seed", str(seed), "--json"]
        result = RUN.invoke(app, args)
        unaware, hybrid = json.loads(result.output)["controllers"]
        assert (unaware["controller"], hybrid["controller"]) == ("unaware", "hybrid")
        ratios.append(hybrid["after"]["rms"] / unaware["after"]["rms"])
    assert np.median(ratios) < 1.0


def test_the_table_names_each_controller_and_what_it_believed() -> None:
    args = ["simulate", "example1", "--take-over", "100", "--samples", "180"]
    args += ["-c", "pi", "-c", "two-move", "--valve-error", "1.2", "-p", "noise_std=0.02"]
    result = RUN.invoke(app, args, env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.output
    assert "two-move" in result.output
    assert "stick band 13.2, slip jump 3.6" in result.output


def test_a_controller_that_decides_nothing_has_no_times() -> None:
    args = ["simulate", "example1", "--take-over", "100", "--samples", "180", "-c", "pi"]
    args += ["-c", "hybrid", "-p", "stick_band=0", "-p", "slip_jump=0", "--json"]
    result = RUN.invoke(app, args)
    assert result.exit_code == 0, result.output
    assert "NaN" not in result.output
    assert json.loads(result.output)["controllers"][1]["decide_ms_median"] is None


def test_set_points_and_loads_are_taken_as_given() -> None:
    study = Simulation(
        "level", ("pi",), 100, 200, setpoint=((20, 52.0),), load=((150, 5.0),), seed=4
    )
    (result,) = simulate(study)
    assert result.trace.sp[19] == pytest.approx(50.0, abs=0.3)
    assert result.trace.sp[20] == 52.0
    other = simulate(Simulation("level", ("pi",), 100, 200, setpoint=((20, 52.0),), seed=4))
    assert (result.trace.pv[:150] == other[0].trace.pv[:150]).all()
    assert result.trace.pv[170] > other[0].trace.pv[170]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["example1", "-c", "magic"], "no controller 'magic'"),
        (["example1", "--setpoint", "5-50"], "is not SAMPLE:VALUE"),
        (["example1", "--setpoint", "9:50,3:40"], "do not increase"),
        (["example1", "-p", "noise"], "is not NAME=NUMBER"),
    ],
)
def test_bad_options_are_named(args: list[str], words: str) -> None:
    result = RUN.invoke(app, ["simulate", *args], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert words in result.output


def test_what_cannot_be_studied_says_what_can() -> None:
    with pytest.raises(SimulationError, match="choose one of example1, example2, level"):
        simulate(Simulation("flow"))
    with pytest.raises(SimulationError, match="--take-over"):
        simulate(Simulation("example1", take_over=50))
