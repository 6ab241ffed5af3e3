"""The door of a scenario file: an error names its place and what to do."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.lab.rehearse import (
    ScenarioError,
    find_scenario,
    load_scenario,
    rehearse,
    shipped_scenarios,
)
from fieldlink.lab.rehearse.event_names import EVENT_NAMES
from fieldlink.site import SiteError
from tests.docs.pages import ROOT

WriteScenario = Callable[..., Path]
COMPENSATED = {
    "controller": 'kind = "pi"\ngain = 1\nintegral_time = 5\ncompensate = true',
    "daemon": "write_back = true",
}


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"daemon": "windows = 5"},
            r"small.toml:15: daemon.windows: unknown key; did you mean 'window'\?",
        ),
        (
            {"controller": 'kind = "pi"'},
            r'controller: kind = "pi" needs its tuning; add gain and integral_time',
        ),
        (
            {"controller": 'kind = "mpc"\ngain = 1.0'},
            r'controller: kind = "mpc" has no gain and integral_time; remove them',
        ),
        (
            {"more": "[valve]\nstick_band = [[10, 1], [5, 2]]"},
            r"valve.stick_band: the time 5 comes after 10; sort the points",
        ),
        (
            {"more": '[[sensor]]\nkind = "drift"\nbegin = 1\nend = 5'},
            r'sensor.0: kind = "drift" needs a rate; give PV per second',
        ),
        (
            {"more": '[[network]]\nkind = "drop"\nbegin = 5\nend = 5'},
            r"network.0: end = 5 is not after begin = 5; exchange or correct them",
        ),
        (
            {"more": '[[maintenance]]\nkind = "repare"\nat = 1'},
            r"maintenance.0.kind: 'repare' is unknown; did you mean 'repair'\?",
        ),
        (
            {"expect": '[[expect]]\nkind = "verdict"\nverdict = "no stiction"'},
            r"expect.0.verdict: 'no stiction' is unknown; did you mean 'no_stiction'\?",
        ),
        (
            {"expect": '[[expect]]\nverdict = "stiction"'},
            r"expect.0.kind: is missing; use one of: verdict, estimate, take_over",
        ),
        (
            {"expect": '[[expect]]\nkind = "verdict"\nverdict = "stiction"\nby = 5'},
            r"expect.0.by: unknown key; use one of: after, before, windows",
        ),
        (
            {"expect": '[[expect]]\nkind = "take_over"'},
            r"expect.0: give either by = SECONDS or never = true; keep one of them",
        ),
        ({"expect": ""}, r"expect: is missing; add it \(The expected results\)"),
        (
            {"controller": 'kind = "pi"\ngain = 1\nintegral_time = 5\ncompensate = true'},
            r"compensate = true needs blocks; set daemon.write_back = true",
        ),
        (
            {"more": "[valve]\nstick_band = [[0, -5]]"},
            r"valve.stick_band: -5 at 0 s is below 0; give 0 or more",
        ),
        (
            {"more": '[[maintenance]]\nkind = "repair"\nat = 9\nstick_band = 1\nslip_jump = 6'},
            r"maintenance.0: slip_jump = 6 is above stick_band = 1; J is a part of S",
        ),
        (
            {"more": '[[sensor]]\nkind = "freeze"\nbegin = 500\nend = 600'},
            r"sensor.0 begins at 500 s and scenario.duration is 120 s; run longer or begin earlier",
        ),
        (
            {"expect": '[[expect]]\nkind = "event"\nevent = "loop.silnt"\nnever = true'},
            r"expect.0.event: 'loop.silnt' is unknown; did you mean 'loop.silent'\?",
        ),
        (
            {"expect": '[[expect]]\nkind = "fall_back"\nby = 100\nreason = ["wrose"]'},
            r"expect.0.reason.0: 'wrose' is unknown; did you mean 'worse'\?",
        ),
        (
            {"expect": '[[expect]]\nkind = "take_over"\nnever = true'},
            r'kind = "take_over" expects something of a compensator that is not there; set',
        ),
        (
            {"expect": '[[expect]]\nkind = "take_over"\nafter = 120\nby = 130', **COMPENSATED},
            r"expect.0 begins at 120 s and scenario.duration is 120 s",
        ),
        (
            {"expect": '[[expect]]\nkind = "blocks"'},
            r"expect.0: any number would do; give at_least or at_most",
        ),
        (
            {"expect": '[[expect]]\nkind = "samples"\nof = "bad"\nat_least = 5\nat_most = 2'},
            r"expect.0: at_least = 5 is above at_most = 2; exchange or correct them",
        ),
        (
            {"first": "duration = 5"},
            r"small.toml:1: duration: unknown key; use one of: scenario, plant",
        ),
    ],
)
def test_a_slip_is_named_with_its_remedy(
    write_scenario: WriteScenario, parts: dict[str, str], message: str
) -> None:
    with pytest.raises(SiteError, match=message):
        load_scenario(write_scenario(**parts))


def test_a_list_whose_only_entry_is_wrong_is_not_empty_too(write_scenario: WriteScenario) -> None:
    with pytest.raises(SiteError) as refused:
        load_scenario(write_scenario(expect='[[expect]]\nkind = "verdikt"'))
    assert [problem.message for problem in refused.value.problems] == ["'verdikt' is unknown"]


def test_a_window_longer_than_the_run_is_refused(write_scenario: WriteScenario) -> None:
    path = write_scenario()
    path.write_text(path.read_text().replace("window = 60", "window = 121"))
    with pytest.raises(SiteError, match=r"one window takes 121 s and scenario.duration is 120 s"):
        load_scenario(path)


def test_each_entry_of_a_list_has_its_own_line(write_scenario: WriteScenario) -> None:
    expect = '[[expect]]\nkind = "pv_std"\nfirst = [0, 5]\nthen = [5, 9]\nat_most = 1\n'
    path = write_scenario(expect=expect + expect.replace("at_most = 1", "at_most = -1"))
    line = path.read_text().splitlines().index("at_most = -1") + 1
    with pytest.raises(SiteError, match=rf"small.toml:{line}: expect.1.at_most: -1"):
        load_scenario(path)


def test_a_name_means_a_shipped_scenario_and_a_path_a_file(write_scenario: WriteScenario) -> None:
    own = write_scenario()
    assert find_scenario(str(own)) == own
    assert find_scenario("healthy-valve") in shipped_scenarios()
    with pytest.raises(ScenarioError, match="did you mean 'healthy-valve'"):
        find_scenario("healthy_valve")
    with pytest.raises(ScenarioError, match=r"there is no scenario file nowhere\.toml"):
        find_scenario("nowhere.toml")


def test_an_fmu_that_is_not_there_is_named_in_the_scenario(write_scenario: WriteScenario) -> None:
    path = write_scenario()
    text = path.read_text()
    path.write_text(text.replace('"example1"', '"nowhere.fmu"'))
    with pytest.raises(SiteError, match=r"small.toml:\d+: plant.fmu: there is no file nowhere.fmu"):
        load_scenario(path)


def test_a_number_in_place_of_points_is_shown_as_points(write_scenario: WriteScenario) -> None:
    with pytest.raises(SiteError, match=r"valve.stick_band: 9 is no array; write .*\[\[0, 9\]\]"):
        load_scenario(write_scenario(more="[valve]\nstick_band = 9"))


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"plant": 'variables = { pv = "pw" }'}, "no output 'pw' for pv.*name it in its plant.var"),
        ({"plant": "parameters = { op_strat = 5.0 }"}, "did you mean 'op_start'?"),
        (
            {"controller": 'kind = "mpc"', "plant": "period = 0.5"},
            "needs a plant with a linear mod",
        ),
        ({"daemon": "stick_band = [20, 0]"}, r"stick_band = \[20, 0\] must be 0 <= low < high"),
    ],
)
def test_what_only_the_plant_or_the_site_can_tell_names_the_scenario(
    write_scenario: WriteScenario, parts: dict[str, str], said: str
) -> None:
    """Of several scenarios in one command the user must know which; the site's file is gone."""
    with pytest.raises((ScenarioError, SiteError), match=rf"small.toml: .*{said}") as refused:
        rehearse(load_scenario(write_scenario(**parts)))
    assert "loop LOOP" not in str(refused.value)


def test_the_events_that_may_be_expected_are_those_of_the_page() -> None:
    page = (ROOT / "docs" / "reference" / "events.md").read_text("utf-8")
    rows = re.findall(r"^\| (`.*?`) \| ([^|]*)\|", page, re.MULTILINE)
    listed = [name for cell, where in rows if "log" not in where for name in cell.split("`")]
    families = {name.partition(".")[0] for name in EVENT_NAMES}
    here = {name for name in listed if name.partition(".")[0] in families}
    # Names of loops change, and stay behind, where a site file is read again.
    known = {name for name in EVENT_NAMES if not name.endswith(".flapping")}
    assert here - {"loop.renamed", "loop.left", "device.flapping"} == known
