"""docs/rehearse.md must show every scenario and defect as it is."""

from __future__ import annotations

import re
from pathlib import Path

from fieldlink.lab.rehearse import Defect, load_scenario, shipped_scenarios

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "rehearse.md").read_text(encoding="utf-8")
TUTORIAL = (DOCS / "tutorials" / "first-rehearsal.md").read_text(encoding="utf-8")


def expected_scenarios() -> str:
    rows = []
    for path in shipped_scenarios():
        summary = load_scenario(path).scenario.scenario
        defects = ", ".join(f"`{defect}`" for defect in summary.defects)
        rows.append(f"| `{path.stem}` | {summary.title} | {defects} |\n")
    return "| scenario | what happens | turned red by |\n| --- | --- | --- |\n" + "".join(rows)


def test_every_scenario_and_defect_is_listed() -> None:
    assert expected_scenarios() in PAGE
    assert all(f"`{defect}`" in PAGE for defect in Defect)


def test_the_events_fit_the_scenario_of_the_tutorial(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml file: feed-valve.toml\n(.*?)```", TUTORIAL, re.DOTALL)
    (events,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "example.toml").write_text(f"{example}\n{events}")
    scenario = load_scenario(tmp_path / "example.toml").scenario
    assert len(scenario.maintenance) == len(scenario.network) == len(scenario.sensor) == 1
