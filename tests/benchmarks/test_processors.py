"""The settings that stand for other processors are understood by the libraries that they name."""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks.processors import SETTINGS, environment_of, lacking, main

ASK = """
import numba, numpy
from numba.core import config
print(config.CPU_NAME, config.CPU_FEATURES is not None)
"""


@pytest.mark.parametrize("setting", SETTINGS)
def test_numpy_and_numba_take_a_setting_without_a_warning(setting: str) -> None:
    if (needed := lacking(setting)) is not None:
        pytest.skip(f"this processor has no {needed}")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", ASK],
        env=environment_of(setting),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    name = SETTINGS[setting].get("NUMBA_CPU_NAME")
    assert done.stdout.split() == [str(name), str(name is not None)]


def test_a_command_that_fails_under_a_setting_is_reported(
    capfd: pytest.CaptureFixture[str],
) -> None:
    look = "import os, sys; sys.exit(os.environ.get('OPENBLAS_CORETYPE') == 'Prescott')"
    assert main(["--settings", "native", "generic", "--", sys.executable, "-c", look]) == 1
    assert capfd.readouterr().out.splitlines() == [
        "native: exit status 0",
        "generic: exit status 1",
    ]
