"""The first page of docs/fmu.md: five commands from an exported FMU to a compensated loop."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.lab.rehearse import load_scenario

PAGE = (Path(__file__).parents[2] / "docs" / "fmu.md").read_text(encoding="utf-8")

_PLANT = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Plant(Fmi2Slave):
    """20 to 120 degC over 0 to 100 % of opening: two lags and a dead time."""
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.opening, self.first, self.temperature = 40.0, 60.0, 60.0
        self.waiting = [40.0] * 30
        self.register_variable(Real("opening", causality=Fmi2Causality.input, start=40.0))
        self.register_variable(Real("temperature", causality=Fmi2Causality.output))
    def do_step(self, time, size):
        for _ in range(round(size / 0.1)):
            self.waiting.append(self.opening)
            self.first += 0.1 / 8.0 * (20.0 + self.waiting.pop(0) - self.first)
            self.temperature += 0.1 / 3.0 * (self.first - self.temperature)
        return True
'''


@pytest.mark.slow
@pytest.mark.parametrize("commands", [3, pytest.param(5, marks=pytest.mark.thorough)])
def test_the_five_commands(tmp_path: Path, commands: int) -> None:
    """All of them with the two rehearsals; without, up to the scenario that they are given."""
    if importlib.util.find_spec("pythonfmu") is None:
        pytest.skip("pythonfmu is not installed: pip install pythonfmu")
    (tmp_path / "plant.py").write_text(_PLANT)
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", "plant.py", "-d", "."]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    (tmp_path / "Plant.fmu").rename(tmp_path / "plant.fmu")
    block = re.search(r"```sh[^\n]*\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    lines = [shlex.split(line) for line in block[1].splitlines()]
    assert len(lines) == 5
    with contextlib.chdir(tmp_path):
        for number, (program, *arguments) in enumerate(lines[:commands], start=1):
            assert program == "fieldlink"
            done = CliRunner().invoke(app, arguments)
            # The last one breaks something on purpose.
            assert done.exit_code == (1 if number == 5 else 0), (arguments, done.output)
    assert (tmp_path / "step.png").stat().st_size > 5000
    assert load_scenario(tmp_path / "plant.toml").scenario.expect
    if commands < len(lines):
        return
    report = (tmp_path / "report" / "plant" / "report.html").read_text()
    assert "A sticky valve before Plant" in report
