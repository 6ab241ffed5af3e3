"""The walls between the packages hold, and the check that keeps them can fail."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def lint_imports(cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
    return subprocess.run(
        [*command, "--no-cache"], cwd=cwd, capture_output=True, text=True, check=False
    )


def test_the_walls_hold() -> None:
    result = lint_imports(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("estimator/leak.py", "import socket"),
        ("compensator/leak.py", "import estimator"),
        ("fieldlink/registers/leak.py", "import time"),
        ("fieldlink/site/leak.py", "import fieldlink.daemon"),
        ("fieldlink/store/leak.py", "import estimator"),
        ("fieldlink/daemon/leak.py", "import fieldlink.lab.plc"),
    ],
)
def test_a_breach_is_found(tmp_path: Path, module: str, line: str) -> None:
    (tmp_path / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text())
    for package in ("fieldlink", "estimator", "compensator", "fmu_models"):
        for init in (ROOT / package).rglob("__init__.py"):
            copy = tmp_path / init.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text("")
    (tmp_path / module).write_text(line + "\n")
    result = lint_imports(tmp_path)
    assert result.returncode == 1, result.stdout + result.stderr
    assert module.removesuffix(".py").replace("/", ".") in result.stdout
