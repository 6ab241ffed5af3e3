"""What a scenario does to its plant, its transmitter, its network and its PLC."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fieldlink.lab.rehearse import (
    Rehearsal,
    ScenarioError,
    ScenarioFile,
    load_scenario,
    rehearse,
)
from fieldlink.lab.rehearse.piecewise import values_over
from fmu_models import fmu_path
from fmu_models.packing import build_source

MakeScenario = Callable[..., ScenarioFile]


def _events(run: Rehearsal, kind: str) -> list[float]:
    return [event.utc_ms / 1000.0 for event in run.course.events if event.kind == kind]


def test_points_are_joined_by_lines_and_two_at_one_time_make_a_step() -> None:
    course = [(10.0, 1.0), (20.0, 3.0), (20.0, 7.0), (30.0, 5.0)]
    times = np.array([0.0, 10.0, 15.0, 19.0, 20.0, 25.0, 99.0])
    assert values_over(course, times).tolist() == [1.0, 1.0, 2.0, 2.8, 7.0, 6.0, 5.0]


def test_the_valve_wears_and_is_repaired(make_scenario: MakeScenario) -> None:
    run = rehearse(
        make_scenario(
            first="setpoint = [[0, 50], [10, 50], [10, 60]]",
            more="[valve]\nstick_band = [[0, 0], [40, 4], [40, 100]]\nslip_jump = [[0, 2]]\n"
            '[[maintenance]]\nkind = "repair"\nat = 100',
        )
    )
    trend = run.course.trend
    assert trend.stick_band[[0, 20, 39, 40, 99, 100]].tolist() == [0.0, 2.0, 3.9, 100.0, 100.0, 0.0]
    # J is never above S.
    assert trend.slip_jump[[0, 10, 20, 39]].tolist() == [0.0, 1.0, 2.0, 2.0]
    # A band wider than the range holds the stem; a healthy stem is where OP is.
    assert np.ptp(trend.stem[41:100]) == 0.0
    assert trend.stem[101:].tolist() == trend.op[101:].tolist()


def test_load_reaches_the_process(make_scenario: MakeScenario) -> None:
    quiet = rehearse(make_scenario(plant="parameters = { stick_band = 0, slip_jump = 0 }"))
    swung = rehearse(
        make_scenario(
            plant="parameters = { stick_band = 0, slip_jump = 0 }",
            more="[load]\nsinusoids = [{ amplitude = 5, period = 40, begin = 20 }]",
        )
    )
    before, after = slice(0, 20), slice(60, 120)
    assert swung.course.trend.pv[before].tolist() == quiet.course.trend.pv[before].tolist()
    assert np.std(swung.course.trend.pv[after]) > 10 * np.std(quiet.course.trend.pv[after])


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ('kind = "freeze"', lambda true: np.full(20, true[0])),
        ('kind = "drift"\nrate = 0.5', lambda true: true + 0.5 * np.arange(20)),
        ('kind = "bad"', lambda _: np.full(20, np.nan)),
    ],
)
def test_a_faulty_transmitter_deceives_controller_and_daemon_alike(
    make_scenario: MakeScenario,
    fault: str,
    expected: Callable[[np.ndarray], np.ndarray],
) -> None:
    run = rehearse(make_scenario(more=f"[[sensor]]\n{fault}\nbegin = 30\nend = 50"))
    trend = run.course.trend
    ill = slice(30, 50)
    np.testing.assert_allclose(trend.measured[ill], expected(trend.pv[ill]))
    well = np.r_[0:30, 50:120]
    np.testing.assert_array_equal(trend.measured[well], trend.pv[well])
    if "bad" in fault:
        assert run.course.counts.bad == 20
        assert np.ptp(trend.op[ill]) == 0.0  # a controller without PV holds OP
        assert not run.passed


def test_spikes_are_single_and_of_the_given_size(make_scenario: MakeScenario) -> None:
    more = '[[sensor]]\nkind = "spikes"\nsize = 3\nshare = 0.2\nbegin = 0\nend = 120'
    trend = rehearse(make_scenario(more=more)).course.trend
    off = trend.measured - trend.pv
    assert set(np.round(np.abs(off), 9)) == {0.0, 3.0}
    assert 10 <= np.count_nonzero(off) <= 40


def test_an_operator_has_the_loop_in_manual(make_scenario: MakeScenario) -> None:
    spell = "begin = 30\nend = 60\nop = [[30, 41], [45, 41], [45, 44]]"
    more = f'[[maintenance]]\nkind = "manual"\n{spell}'
    trend = rehearse(make_scenario(more=more)).course.trend
    assert not trend.automatic[30:60].any()
    assert trend.automatic[[29, 60]].all()
    assert trend.op[[30, 44, 45, 59]].tolist() == [41.0, 41.0, 44.0, 44.0]


def test_unanswered_polls_are_missed_and_keep_their_places(make_scenario: MakeScenario) -> None:
    run = rehearse(make_scenario(more='[[network]]\nkind = "drop"\nbegin = 70\nend = 80'))
    counts = run.course.counts
    assert (counts.read, counts.missed, counts.duplicates) == (110, 10, 0)
    assert len(run.course.trend.time) == 120  # the PLC went on
    assert _events(run, "device.demoted") == [70.0]


def test_late_polls_repeat_a_cycle_and_lose_none_but_one(make_scenario: MakeScenario) -> None:
    run = rehearse(make_scenario(more='[[network]]\nkind = "late"\nbegin = 70\nend = 80'))
    counts = run.course.counts
    assert counts.duplicates == 1  # the first late poll meets what the poll before had
    assert (counts.read, counts.missed) == (119, 1)  # the last late cycle is never polled


def test_a_plc_without_power_lets_the_plant_coast_and_counts_again(
    make_scenario: MakeScenario,
) -> None:
    run = rehearse(
        make_scenario(
            first="setpoint = [[0, 50], [5, 50], [5, 60]]",
            plant="parameters = { stick_band = 0, slip_jump = 0, op_start = 50 }",
            more='[[network]]\nkind = "restart"\nbegin = 20\nend = 40',
        )
    )
    trend, counts = run.course.trend, run.course.counts
    assert counts.restarts == 1
    assert counts.missed == 20
    assert np.ptp(trend.op[19:40]) == 0.0
    assert np.ptp(trend.pv[20:40]) > 1.0  # the process goes on towards the OP that it was left
    assert abs(trend.op[40] - trend.op[39]) < 20.0
    assert trend.time.tolist() == list(range(120))


def test_the_same_scenario_gives_the_same_run(make_scenario: MakeScenario) -> None:
    more = '[[network]]\nkind = "drop"\nbegin = 10\nend = 100\nshare = 0.3'
    one, other = (rehearse(make_scenario(more=more)).course for _ in range(2))
    assert one.trend.pv.tolist() == other.trend.pv.tolist()
    assert one.counts == other.counts


def test_a_variable_that_the_plant_lacks_is_named(make_scenario: MakeScenario) -> None:
    more = '[valve]\nstick_band = [[0, 1]]\n[plant.variables]\nstick_band = "S"'
    with pytest.raises(ScenarioError, match=r"by the name 'S'; it has op, load, .*stick_band"):
        rehearse(make_scenario(more=more))


def test_a_plant_that_is_not_there_is_named(make_scenario: MakeScenario) -> None:
    file = make_scenario()
    plant = file.scenario.plant.model_copy(update={"fmu": "exampel1"})
    scenario = file.scenario.model_copy(update={"plant": plant})
    with pytest.raises(ScenarioError, match="did you mean 'example1'"):
        rehearse(ScenarioFile(file.name, file.path, scenario))


def test_an_fmu_of_one_s_own_with_names_of_its_own(make_scenario: MakeScenario) -> None:
    """Loop 2 of the four tanks as a file, as anybody's FMU would be."""
    file = make_scenario(
        first="setpoint = [[0, 12]]",
        controller='kind = "pi"\ngain = 22.5\nintegral_time = 40.0',
        more="[valve]\nstick_band = [[0, 3]]\nslip_jump = [[0, 1]]\n"
        '[plant.variables]\nop = "op2"\npv = "pv2"\nstem = "stem2"\nload = "load2"\n'
        'stick_band = "stick_band2"\nslip_jump = "slip_jump2"',
    )
    copied = shutil.copy(fmu_path("fourtank"), file.path.with_name("tanks.fmu"))
    file.path.write_text(file.path.read_text().replace('"example1"', f'"{copied.name}"'))
    trend = rehearse(load_scenario(file.path)).course.trend
    assert np.isfinite(trend.stem).all()
    moved = np.abs(np.diff(trend.stem))
    assert np.count_nonzero(moved) > 5
    # A valve with J = 1 and S = 3 leaves its place when OP is 2 away, and then by more than J.
    assert moved[moved > 0.0].min() >= 1.0


def test_a_plant_that_fails_ends_the_rehearsal_with_its_cause(
    make_scenario: MakeScenario, tmp_path: Path
) -> None:
    sources = Path(__file__).parents[1] / "fmu_models" / "sources"
    built = build_source(sources / "faulty.c", output=tmp_path)[1]
    file = make_scenario(plant="parameters = { fault = 2 }")
    file.path.write_text(file.path.read_text().replace('"example1"', f'"{built.name}"'))
    with pytest.raises(ScenarioError, match=r"cannot go on at 0 s: .*died of SIGSEGV"):
        rehearse(load_scenario(file.path))


def test_a_valve_in_front_of_the_fmu_is_the_valve_inside(make_scenario: MakeScenario) -> None:
    valve = "[valve]\nstick_band = [[0, 6]]\nslip_jump = [[0, 2]]\n"
    first = "setpoint = [[0, 50], [10, 50], [10, 60], [60, 45]]"
    inside = rehearse(make_scenario(first=first, more=valve)).course.trend
    healthy = "parameters = { valve = 0 }"
    front = make_scenario(first=first, plant=healthy, more=valve + "in_front = true\n")
    outside = rehearse(front).course.trend
    np.testing.assert_allclose(outside.stem, inside.stem, rtol=1e-12)
    np.testing.assert_allclose(outside.pv, inside.pv, rtol=1e-9)
    assert np.ptp(inside.stem) > 3.0


@pytest.mark.parametrize("kind", ["write_flipped", "write_torn"])
def test_a_damaged_block_is_not_committed(make_scenario: MakeScenario, kind: str) -> None:
    run = rehearse(
        make_scenario(
            controller='kind = "mpc"\ncompensate = true',
            daemon="write_back = true",
            plant="parameters = { stick_band = 11, slip_jump = 3, op_start = 40 }",
            more=f'[[network]]\nkind = "{kind}"\nbegin = 0\nend = 120',
        )
    )
    outcomes = {record.outcome for record in run.course.writebacks}
    assert "readback_differs" in outcomes
    assert not outcomes & {"committed", "accepted"}
