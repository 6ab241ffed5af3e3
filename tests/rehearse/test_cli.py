"""``fieldlink rehearse`` as a user runs it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.lab.rehearse import ScenarioError
from tests.cli.typed import run_typed

FAILING = '[[expect]]\nkind = "samples"\nof = "missed"\nat_least = 1\n'

WriteScenario = Callable[..., Path]


def in_this_process(*arguments: str) -> Result:
    """What needs no process of its own: the same command without its start."""
    return CliRunner().invoke(app, ["rehearse", *arguments])


def test_without_a_scenario_it_lists_the_shipped_ones() -> None:
    run = in_this_process()
    assert run.exit_code == 0, run.output
    assert re.search(r"^healthy-valve +A healthy valve stays unsuspected", run.stdout, re.M)
    assert re.search(r"^growing-stiction ", run.stdout, re.M)


@pytest.mark.slow
def test_a_run_prints_what_was_found_and_ends_with_its_status(
    write_scenario: WriteScenario, tmp_path: Path
) -> None:
    passed = run_typed(tmp_path, "rehearse", write_scenario())
    assert passed.returncode == 0, passed.stderr
    assert re.search(r"passed +samples: bad, at most 0 +0", passed.stdout)
    assert "120 plant seconds in" in passed.stdout
    failed = run_typed(tmp_path, "rehearse", write_scenario(expect=FAILING))
    assert failed.returncode == 1, failed.stderr
    assert re.search(r"failed +samples: missed, at least 1 +0", failed.stdout)


@pytest.mark.slow
def test_json_and_report(write_scenario: WriteScenario, tmp_path: Path) -> None:
    folder = tmp_path / "reports"
    scenario = write_scenario(expect=FAILING)
    run = run_typed(tmp_path, "rehearse", scenario, "--json", "--report", folder)
    assert run.returncode == 1, run.stderr
    document = json.loads(run.stdout)
    assert document["passed"] is False
    assert document["expectations"][0]["found"] == "0"
    assert [window["end"] for window in document["windows"]] == [60.0]
    page = (folder / "small" / "report.html").read_text()
    assert "samples: missed, at least 1" in page
    assert "<svg" in page
    assert not re.search(r'(?:src|href)="(?!#)', page)  # nothing is fetched from anywhere
    assert (folder / "small" / "rehearsal.png").read_bytes().startswith(b"\x89PNG")
    assert 'fmu = "example1"' in (folder / "small" / "site.toml").read_text()


@pytest.mark.slow
def test_what_a_user_gets_wrong_is_reported(write_scenario: WriteScenario, tmp_path: Path) -> None:
    slip = run_typed(tmp_path, "rehearse", write_scenario(daemon="windows = 3"))
    assert slip.returncode == 2
    assert "daemon.windows: unknown key; did you mean 'window'?" in slip.stderr
    with pytest.raises(ScenarioError, match="did you mean 'healthy-valve'"):
        CliRunner().invoke(app, ["rehearse", "healthy_valve"], catch_exceptions=False)
    defect = in_this_process("healthy-valve", "--inject", "gremlins")
    assert defect.exit_code == 2
    assert "'gremlins' is unknown" in re.sub(r"\s+", " ", defect.output)


def test_the_defects_are_listed() -> None:
    run = in_this_process("--inject", "list")
    assert run.exit_code == 0, run.output
    assert re.search(r"^no-repair +the repair is not done", run.stdout, re.M)


@pytest.mark.parametrize(("defect", "status"), [("closed-gaps", 0), ("no-repair", 1)])
def test_a_self_test_wants_every_defect_to_show(
    write_scenario: WriteScenario, defect: str, status: int
) -> None:
    path = write_scenario(
        more='[[network]]\nkind = "drop"\nbegin = 70\nend = 80',
        expect=FAILING.replace("at_least = 1", "at_least = 10"),
    )
    path.write_text(path.read_text().replace("duration", f'defects = ["{defect}"]\nduration'))
    run = in_this_process(str(path), "--self-test")
    assert run.exit_code == status, run.output
    assert re.search(rf"small +{defect} +(failed +yes|passed +no)", run.output)


@pytest.mark.parametrize(
    "option", [["--self-test"], ["--report", "out"], ["--inject", "no-repair"]]
)
def test_what_asks_for_a_run_needs_a_scenario(option: list[str]) -> None:
    run = in_this_process(*option)
    assert run.exit_code == 2, run.output
    assert "--all" in run.output


def test_a_self_test_without_a_defect_proves_nothing(write_scenario: WriteScenario) -> None:
    run = in_this_process(str(write_scenario()), "--self-test")
    assert run.exit_code == 2, run.output
    assert "names no defect that must make it fail" in re.sub(r"[\s│]+", " ", run.output)
