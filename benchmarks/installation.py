"""What an installation takes: megabytes on disk and the time until a command answers.

    python -m benchmarks.installation [--out docs/benchmarks]
    python -m benchmarks.installation --contents fieldlink-0.2.0-py3-none-any.whl

The wheel is built and installed into empty environments: as an edge box needs it, with the
simulated plants (`lab`), and with everything (`all`). Megabytes are those of the environment, the
interpreter's own (a link) and pip not counted. Start-up is the processor time of a command that
has run before, as a multiple of an empty Python program's on the same machine: seconds depend on
the machine, the ratio much less. `--contents` only looks into a wheel: what it must carry and
does not, and what must not be in it.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import heading, keep, machine, table

__all__ = ["main", "problems_of"]

ROOT = Path(__file__).resolve().parents[1]

KINDS = {"edge box": "", "with plants": "[lab]", "everything": "[all]"}
"""What is measured, and the extras of it."""

COMMANDS = (
    ("--version",),
    ("--help",),
    ("check", "site_configs/two_loops.toml"),
)
REPEATS = 5
"""Runs of a command, of which the quickest counts: the others waited for the disk."""

PACKAGES = ("fieldlink", "estimator", "compensator", "fmu_models")
MODULES = ("compiled.py", "loop_model.py")


def problems_of(wheel: Path) -> list[str]:
    """Return what a wheel lacks and what does not belong into it, a line each."""
    with zipfile.ZipFile(wheel) as archive:
        carried = set(archive.namelist())
    wanted = {*MODULES}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            name = path.relative_to(ROOT).as_posix()
            if path.is_file() and "__pycache__" not in name and not path.name.startswith("."):
                wanted.add(name)
    found = [f"lacks {name}" for name in sorted(wanted - carried)]
    for name in sorted(carried - wanted):
        if not name.split("/")[0].endswith(".dist-info"):
            found.append(f"carries {name}")
    return found


def _installed(wheel: Path, extras: str, folder: Path) -> Path:
    """Install a wheel into an empty environment; return its Python."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    command = [str(python), "-m", "pip", "install", "--quiet", f"{wheel}{extras}"]
    subprocess.run(command, check=True)
    return python


def _megabytes(folder: Path) -> float:
    total = 0
    for path in folder.rglob("*"):
        if path.is_file() and not path.is_symlink() and "/site-packages/pip" not in str(path):
            total += path.stat().st_size
    return total / 1e6


def _packages(python: Path) -> int:
    command = [str(python), "-m", "pip", "list", "--format", "freeze"]
    return len(subprocess.check_output(command, text=True).splitlines())


def _processor_seconds(command: Sequence[str]) -> float:
    """Processor time of a command, the quickest of some runs."""
    seconds = []
    for _ in range(REPEATS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
        seconds.append(user + system)
    return min(seconds)


def _measure(wheel: Path, root: Path) -> list[dict[str, Any]]:
    rows = []
    for name, extras in KINDS.items():
        folder = root / name.replace(" ", "-")
        python = _installed(wheel, extras, folder)
        empty = _processor_seconds([str(python), "-c", "pass"])
        program = str(folder / "bin" / "fieldlink")
        rows.append(
            {
                "installation": name,
                "pip install": f"fieldlink{extras}",
                "packages": _packages(python),
                "MB": round(_megabytes(folder)),
                **{
                    f"{command[0]}, times python": _processor_seconds([program, *command]) / empty
                    for command in COMMANDS
                },
            }
        )
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or look into a wheel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--contents", type=Path, metavar="WHEEL", help="only look into a wheel")
    parser.add_argument("--wheel", type=Path, help="measure this one instead of a new one")
    parser.add_argument("--out", type=Path, help="folder for installation.md and .json")
    options = parser.parse_args(arguments)
    if options.contents is not None:
        problems = problems_of(options.contents)
        print("\n".join(problems) or f"{options.contents.name}: complete, and holds no other file")
        return min(1, len(problems))
    with tempfile.TemporaryDirectory(prefix="installation") as name:
        root = Path(name)
        wheel = options.wheel
        if wheel is None:
            build = [sys.executable, "-m", "fmu_models.wheel", "--host-only", "--output", name]
            subprocess.run(build, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
            (wheel,) = root.glob("*.whl")
        rows = _measure(wheel.resolve(), root)
        size = wheel.stat().st_size / 1e6
    text = table(list(rows[0]), [list(row.values()) for row in rows])
    words = f"The wheel itself has {size:.1f} MB, its FMUs for one platform."
    text = "\n\n".join([heading("installation", __doc__, arguments), text, words])
    print(text)
    keep(options.out, "installation", text, {"machine": machine(), "rows": rows, "wheel_MB": size})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
