"""Every shipped scenario passes, and turns red when what it is about is broken."""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.lab.rehearse import Defect, load_scenario, rehearse, shipped_scenarios

SHIPPED = {path.stem: path for path in shipped_scenarios()}

WANTED = {
    "healthy-valve",
    "growing-stiction",
    "tuning-fault",
    "external-oscillation",
    "sensor-freeze",
    "maintenance",
}
"""What a set of rehearsals must have before anyone goes to site."""

LONG = {
    "compensated",
    "damaged-blocks",
    "growing-stiction",
    "maintenance",
    "plc-restart",
    "sensor-freeze",
    "wrong-model",
    "wrong-sign",
}
"""Those that simulate for longest: three quarters of the processor time of all."""


def test_the_shipped_set_is_complete() -> None:
    assert len(SHIPPED) >= 10
    assert set(SHIPPED) >= WANTED


@pytest.mark.parametrize("path", SHIPPED.values(), ids=list(SHIPPED))
def test_a_shipped_scenario_says_what_it_shows_and_what_must_break_it(path: Path) -> None:
    summary = load_scenario(path).scenario.scenario
    assert summary.text.strip().endswith(".")
    assert summary.defects


def test_every_defect_breaks_some_scenario() -> None:
    used = {d for path in SHIPPED.values() for d in load_scenario(path).scenario.scenario.defects}
    assert used == set(Defect)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=name, marks=pytest.mark.thorough if name in LONG else ())
        for name, path in SHIPPED.items()
    ],
)
def test_it_passes(path: Path) -> None:
    run = rehearse(load_scenario(path))
    assert run.passed, [finding for finding in run.findings if not finding.passed]


@pytest.mark.thorough
@pytest.mark.parametrize("path", SHIPPED.values(), ids=list(SHIPPED))
def test_it_fails_with_its_defect(path: Path) -> None:
    """With the first one; ``fieldlink rehearse --all --self-test`` goes through all of them."""
    file = load_scenario(path)
    run = rehearse(file, inject=file.scenario.scenario.defects[0])
    assert not run.passed, [finding.found for finding in run.findings]
