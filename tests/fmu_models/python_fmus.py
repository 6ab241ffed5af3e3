"""FMUs that pythonfmu and pythonfmu3 export: a tank, and one that raises an exception."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

__all__ = ["TOOLS", "build", "is_installed"]

TOOLS = ("pythonfmu", "pythonfmu3")

_SLAVE2 = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

class Tank(Fmi2Slave):
    author = "a test"
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.inflow, self.level, self.count, self.high = 0.0, 1.0, 0, False
        self.label = "tank"
        self.register_variable(Real("inflow", causality=Fmi2Causality.input))
        self.register_variable(Real("level", causality=Fmi2Causality.output))
        self.register_variable(Integer("count", causality=Fmi2Causality.output))
        self.register_variable(Boolean("high", causality=Fmi2Causality.output))
        self.register_variable(
            String("label", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
    def exit_initialization_mode(self):
        self.level = 1.0 if self.label == "tank" else float(len(self.label))
    def do_step(self, time, size):
        if self.inflow < 0.0:
            return False
        if self.inflow > 90.0:
            raise ValueError("the pipe has burst")
        self.level += size * (self.inflow - 0.5 * self.level)
        self.count += 1
        self.high = self.level > 2.0
        return True
"""
_SLAVE3 = """
from pythonfmu3 import Boolean, Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult
from pythonfmu3 import Fmi3Variability, Float64, Int64, String

class Tank(Fmi3Slave):
    author = "a test"
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.inflow, self.level, self.count, self.high = 0.0, 0.0, 1.0, 0, False
        self.label = "tank"
        self.register_variable(Float64("time", causality=Fmi3Causality.independent))
        self.register_variable(Float64("inflow", causality=Fmi3Causality.input))
        self.register_variable(Float64("level", causality=Fmi3Causality.output))
        self.register_variable(Int64("count", causality=Fmi3Causality.output))
        self.register_variable(Boolean("high", causality=Fmi3Causality.output))
        self.register_variable(
            String("label", causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable)
        )
    def exit_initialization_mode(self):
        self.level = 1.0 if self.label == "tank" else float(len(self.label))
    def do_step(self, time, size):
        if self.inflow > 90.0:
            raise ValueError("the pipe has burst")
        if self.inflow < 0.0:
            return Fmi3StepResult(status=Fmi3Status.discard)
        self.level += size * (self.inflow - 0.5 * self.level)
        self.count += 1
        self.high = self.level > 2.0
        return Fmi3StepResult(status=Fmi3Status.ok)
"""
_SCRIPTS = {"pythonfmu": _SLAVE2, "pythonfmu3": _SLAVE3}


def is_installed(tool: str) -> bool:
    """Whether the tool can build."""
    return importlib.util.find_spec(tool) is not None


def build(tool: str, folder: Path) -> Path:
    """Export the tank with ``tool`` into ``folder``."""
    source = folder / f"tank_{tool}.py"  # one module a tool in the process
    source.write_text(_SCRIPTS[tool])
    done = subprocess.run(
        [sys.executable, "-m", tool, "build", "-f", str(source), "-d", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.fmu"))
