"""A process without a valve becomes a loop to rehearse: step test, tuning, scenario."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fieldlink.lab.fmu import FmuError
from fieldlink.lab.fmu.loop_scenario import write_scenario
from fieldlink.lab.fmu.step_test import LoopWish, is_share, respond
from fieldlink.lab.plc.build import LoopSetup
from fieldlink.lab.rehearse import Defect, load_scenario, rehearse
from fieldlink.lab.rehearse.briefing import list_findings
from fieldlink.lab.rehearse.happenings import Manual
from fieldlink.lab.rehearse.site_files import LOOP, write_site
from fmu_models import fmu_path, summarise

TANK = LoopWish("tank.inflow[1]", "tank.h", period=0.1)


def test_the_step_test_finds_lag_and_gain(mini_fmus: dict[str, Path]) -> None:
    """dh/dt = inflow - h: gain 1, lag 1 s, no dead time."""
    response = respond(summarise(mini_fmus["fmi2"]), TANK)
    assert (response.gain, response.lag) == pytest.approx((1.0, 1.0), rel=0.1)
    assert response.dead_time <= 0.1
    assert response.start == pytest.approx(40.0)  # at rest with OP at 40, not empty as at first
    assert not response.integrates
    slow = respond(summarise(mini_fmus["fmi2"]), LoopWish("tank.inflow[1]", "tank.h", period=0.5))
    assert slow.gain == pytest.approx(1.0, rel=0.02)


def test_an_opening_from_0_to_1_is_named(mini_fmus: dict[str, Path]) -> None:
    fmu = summarise(mini_fmus["fmi2"])
    place = next(n for n, v in enumerate(fmu.variables) if v.name == "tank.inflow[1]")
    for low, high, start, named in (
        ("0", "1", "0.5", True), ("", "", "0.5", True), ("0", "100", "0.5", False),
        ("", "", "50", False), ("", "", "", False),
    ):  # fmt: skip
        told = replace(fmu.variables[place], low=low, high=high, start=start)
        variables = (*fmu.variables[:place], told, *fmu.variables[place + 1 :])
        assert is_share(replace(fmu, variables=variables), told.name) is named


def test_an_opening_from_0_to_1_is_scaled_or_refused(
    mini_fmus: dict[str, Path], tmp_path: Path
) -> None:
    """dh/dt = inflow - h, the inflow as an opening: 1 % of OP is 0.01."""
    fmu = summarise(mini_fmus["fmi2"])
    place = next(n for n, v in enumerate(fmu.variables) if v.name == TANK.op)
    opening = replace(fmu.variables[place], low="0", high="1", start="0.4")
    told = replace(fmu, variables=(*fmu.variables[:place], opening, *fmu.variables[place + 1 :]))
    with pytest.raises(FmuError, match=r"goes from 0 to 1.*give --op-scale 0\.01"):
        respond(told, TANK)
    wish = replace(TANK, op_scale=0.01)
    response = respond(told, wish)
    assert (response.op, response.start) == pytest.approx((40.0, 0.4))
    assert response.gain == pytest.approx(0.01, rel=0.1)
    file = tmp_path / "tank.toml"
    write_scenario(told, wish, response, file)
    scenario = load_scenario(file).scenario
    assert scenario.plant.variables.op_scale == 0.01
    folder = tmp_path / "site"
    folder.mkdir()
    setup = LoopSetup.of(write_site(scenario, file, folder), LOOP)
    assert setup.op == pytest.approx(40.0)
    # OP of the PLC is percent, and the tank gets a hundredth of it.
    with setup.open() as plant:
        assert plant.run(200, {TANK.op: 40.0})[TANK.pv][-1] == pytest.approx(0.4, rel=1e-3)
        for _ in range(200):
            found = plant.step({TANK.op: 60.0})
        assert found[TANK.pv] == pytest.approx(0.6, rel=1e-3)


def test_an_integrating_process_is_seen(tmp_path: Path) -> None:
    level = LoopWish("op", "pv", op_start=50.0)
    fmu = summarise(fmu_path("level"))
    # Without a step of its own there is nothing to scale the scan by: no lag, no dead time.
    for described in (fmu, replace(fmu, step_size=None)):
        response = respond(described, level)
        assert response.integrates
        gain, integral_time = response.tune()
        assert gain * response.gain > 0.0
        assert integral_time > response.period > 0.1
        file = tmp_path / f"{described.step_size}.toml"
        write_scenario(described, level, response, file)
        steps = [value for _, value in load_scenario(file).scenario.setpoint]
        # What 4 % of OP does to PV in five scans at least: the controller has to answer.
        assert max(steps) - min(steps) >= 4.0 * abs(response.gain) * 5.0 * response.period * 0.99


def test_the_loop_is_identified_and_compensated(mini_fmus: dict[str, Path], tmp_path: Path) -> None:
    fmu = shutil.copy(mini_fmus["fmi2"], tmp_path / "tank.fmu")
    file = tmp_path / "tank.toml"
    done = CliRunner().invoke(
        app,
        ["loop", str(fmu), "--op", TANK.op, "--pv", TANK.pv, "--period", "0.1", "--op-start", "40",
         "--output", str(file)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "fieldlink rehearse" in done.output
    run = rehearse(load_scenario(file))
    assert run.passed, run.findings
    # The confidence is that of the site that was run.
    assert "90 % interval" in dict(list_findings(run, ""))["Stick band S, last found"]
    trend = run.course.trend
    # The valve is ours: the stem stands still or lies fD short of OP, never further off than fS.
    assert np.abs(trend.op - trend.stem).max() <= 0.5 * (5.0 + 1.5) + 1e-9
    assert trend.compensated.any()


@pytest.mark.parametrize(
    ("defect", "outcome"),
    [
        (Defect.TORN_BLOCKS, "readback_differs"),
        (Defect.WRONG_SIGN, "writeback.refused"),
        (Defect.HEALTHY_VALVE, "too_few_windows"),
        pytest.param(Defect.DAMAGED_BLOCKS, "readback_differs", marks=pytest.mark.thorough),
    ],
)
def test_defects_act_on_a_plant_of_ones_own(
    mini_fmus: dict[str, Path], tmp_path: Path, defect: Defect, outcome: str
) -> None:
    """The FMU has no valve: it stands in front of it, sound or not; blocks never take over."""
    fmu, file = summarise(mini_fmus["fmi2"]), tmp_path / "tank.toml"
    wish = replace(TANK, op_start=40.0)
    write_scenario(fmu, wish, respond(fmu, wish), file)
    written = load_scenario(file)
    scenario = written.scenario
    summary = scenario.scenario.model_copy(update={"duration": 68.0})  # a window of 60 s and some
    daemon = scenario.daemon.model_copy(
        update={"min_windows": 1 + (defect is Defect.HEALTHY_VALVE), "estimate_every": 60.0}
    )
    manual = Manual(kind="manual", begin=66.0, end=67.0, op=((66.0, 40.0), (67.0, 48.0)))
    update = {"scenario": summary, "daemon": daemon, "maintenance": (manual,)}
    run = rehearse(replace(written, scenario=scenario.model_copy(update=update)), inject=defect)
    outcomes = {record.outcome for record in run.course.writebacks}
    assert outcome in outcomes | {record.kind for record in run.course.events}
    trend = run.course.trend
    assert not trend.compensated.any()
    by_hand = (trend.time >= 66.0) & (trend.time < 67.0)
    np.testing.assert_allclose(trend.op[by_hand], 40.0 + 8.0 * (trend.time[by_hand] - 66.0))
    assert (trend.stick_band == (0.0 if defect is Defect.HEALTHY_VALVE else 5.0)).all()


def test_what_is_refused(mini_fmus: dict[str, Path], tmp_path: Path) -> None:
    fmu = summarise(mini_fmus["fmi2"])
    with pytest.raises(
        FmuError, match=r"no input 'tank\.inflow'; did you mean 'tank\.inflow\[1\]'"
    ):
        respond(fmu, LoopWish("tank.inflow", "tank.h", period=0.1))
    with pytest.raises(FmuError, match=r"batch does not answer to tank\.inflow\[1\] stepping"):
        respond(fmu, LoopWish("tank.inflow[1]", "batch", period=0.1))
    file = tmp_path / "there.toml"
    file.write_text("mine")
    with pytest.raises(FmuError, match="it exists; remove it, or name another with --output"):
        write_scenario(fmu, TANK, respond(fmu, TANK), file)
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        (("3", "5"), "S = 3 cannot jump by J = 5; give at most 3"),
        (("1", "1.5"), "S = 1 cannot jump by J = 1.5"),
        (("0", "0"), "greater than or equal to 0.1"),
        (("200", "1"), "less than or equal to 100"),
    ],
)
def test_a_valve_that_cannot_be_is_refused(
    mini_fmus: dict[str, Path], tmp_path: Path, sizes: tuple[str, str], said: str
) -> None:
    file = tmp_path / "x.toml"
    given = ("--stick-band", sizes[0], "--slip-jump", sizes[1], "--output", str(file))
    fmu = str(mini_fmus["fmi2"])
    command = ["loop", fmu, "--op", "tank.inflow[1]", "--pv", "tank.h", *given]
    result = CliRunner().invoke(app, command, env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert said in result.output
    assert not file.exists()


def test_a_plant_that_is_written_wrong_is_suggested() -> None:
    done = CliRunner().invoke(app, ["info", "exampel1"])
    assert done.exit_code == 2
    said = " ".join(done.output.replace("│", " ").split())
    assert "exampel1 is neither a file nor a plant of the catalogue" in said
    assert "did you mean 'example1'" in said


@pytest.mark.parametrize(("name", "own"), [("flow", 0.18), ("level", 0.21)])
def test_a_valve_of_the_plants_own_is_told_and_can_be_switched_off(name: str, own: float) -> None:
    """Two sticky valves in series have neither's stick band, and the step test no true gain."""
    fmu = summarise(fmu_path(name))
    sticky = respond(fmu, LoopWish("op", "pv", period=1.0))
    assert sticky.has_own_valve
    assert sticky.remains == pytest.approx(own, abs=0.02)
    healthy = respond(fmu, LoopWish("op", "pv", period=1.0, start_values={"valve": 0.0}))
    assert not healthy.has_own_valve
    assert healthy.gain > 1.1 * sticky.gain


def test_the_command_names_the_plants_own_valve(tmp_path: Path) -> None:
    file = tmp_path / "flow.toml"
    arguments = ["loop", "flow", "--op", "op", "--pv", "pv", "--period", "1", "--out", str(file)]
    told = CliRunner().invoke(app, arguments)
    assert "a sticky valve of its own" in told.output
    file.unlink()
    told = CliRunner().invoke(app, [*arguments, "--set", "valve=0"])
    assert "of its own" not in told.output
    assert load_scenario(file).scenario.plant.parameters == {"valve": 0.0, "op": 50.0}
