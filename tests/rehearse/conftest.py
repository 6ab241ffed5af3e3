"""Small scenarios that take no time: one window, nothing to judge by the estimator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.lab.rehearse import ScenarioFile, load_scenario

SMALL = """\
{first}
[scenario]
title = "small"
duration = 120
[plant]
fmu = "example1"
{plant}
[controller]
{controller}
[daemon]
window = 60
estimate_every = 1000
{daemon}
{more}
{expect}
"""

EXPECT = """\
[[expect]]
kind = "samples"
of = "bad"
at_most = 0
"""

PI = 'kind = "pi"\ngain = 0.8\nintegral_time = 10.0'

MakeScenario = Callable[..., ScenarioFile]


@pytest.fixture
def write_scenario(tmp_path: Path) -> Callable[..., Path]:
    """Write a small scenario; parts of its text can be given."""

    def write(
        *,
        first: str = "",
        plant: str = "",
        controller: str = PI,
        daemon: str = "",
        more: str = "",
        expect: str = EXPECT,
    ) -> Path:
        path = tmp_path / "small.toml"
        path.write_text(
            SMALL.format(
                first=first,
                plant=plant,
                controller=controller,
                daemon=daemon,
                more=more,
                expect=expect,
            )
        )
        return path

    return write


@pytest.fixture
def make_scenario(write_scenario: Callable[..., Path]) -> MakeScenario:
    """Write a small scenario and load it."""
    return lambda **parts: load_scenario(write_scenario(**parts))
