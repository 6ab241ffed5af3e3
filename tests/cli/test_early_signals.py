"""A service that is told to stop while it is still being loaded stops, and says nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

PROGRAM = """
import os, signal, sys

class Signals:
    def find_spec(self, name, *_):
        for number, at in SENT:
            if name == at:
                os.kill(os.getpid(), number)

PAIRS = [word.split(":") for word in sys.argv.pop(1).split(",")]
SENT = [(getattr(signal, name), module) for name, module in PAIRS]
sys.meta_path.insert(0, Signals())
from fieldlink.cli import main
main()
"""


def run(signals: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the program, and send it signals as it begins to import certain modules."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, signals, *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
@pytest.mark.parametrize("module", ["fieldlink.cli.app", "fieldlink.daemon", "fieldlink.site"])
def test_a_service_that_is_stopped_while_it_loads(name: str, module: str, tmp_path: Path) -> None:
    result = run(f"{name}:{module}", "run", str(tmp_path / "site.toml"))
    assert result.returncode == 0, result.stderr
    assert result.stderr == "fieldlink: stopped before it had started\n"


IN_A_CALLBACK = """
import ctypes, os, signal, sys
from fieldlink.cli.early_signals import heed_early_signals

heed_early_signals(["fieldlink", "run"])

@ctypes.CFUNCTYPE(None)
def called_by_c():
    os.kill(os.getpid(), signal.SIGTERM)
    print("the signal is answered before this line")

called_by_c()
print("still there")
"""


def test_an_order_to_stop_is_not_lost_in_a_callback_of_a_compiler() -> None:
    """ctypes passes no exception on: a stop while kernels were compiled ended in a traceback."""
    result = subprocess.run(
        [sys.executable, "-c", IN_A_CALLBACK],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert result.stderr == "fieldlink: stopped before it had started\n"
    assert (result.returncode, result.stdout) == (0, "")


def test_a_reload_that_comes_too_early_harms_nothing(tmp_path: Path) -> None:
    signals = "SIGHUP:fieldlink.cli.app,SIGHUP:fieldlink.daemon"
    result = run(signals, "run", str(tmp_path / "site.toml"))
    assert result.returncode == 2
    assert "site.toml: cannot be read (No such file" in result.stderr


def test_other_commands_end_as_programs_do(tmp_path: Path) -> None:
    assert run("SIGTERM:fieldlink.site", "check", str(tmp_path / "site.toml")).returncode == -15
