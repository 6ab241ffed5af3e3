"""Build the wheel that needs no compiler: ``python -m fmu_models.wheel --output dist``.

The plants are built for every platform first (with zig, ``pip install ziglang``), so that the wheel
carries them; ``--host-only`` builds them for this machine's platform with its own compiler. The
wheel is made from a copy of the tree: what an earlier one left in ``build`` cannot get into it.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from . import build
from .catalogue import catalogue
from .packing import FMI_VERSIONS, target_file

__all__ = ["main", "missing_plants"]

_LEFT_OUT = (
    *(".*", "build", "dist", "tests", "docs", "benchmarks", "fieldlink-demo"),
    *("__pycache__", "*.egg-info"),
)


def main(arguments: list[str] | None = None) -> int:
    """Build plants and wheel; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m fmu_models.wheel", description=main.__doc__)
    parser.add_argument("--output", type=Path, default=Path("dist"), help="folder of the wheel")
    parser.add_argument("--source", type=Path, default=Path(), help="folder of pyproject.toml")
    parser.add_argument("--host-only", action="store_true", help="plants for this platform only")
    options = parser.parse_args(arguments)
    status = build.main([] if options.host_only else ["--all-platforms"])
    if status != 0:
        return status
    if not (options.source / "pyproject.toml").is_file():
        print(
            f"{options.source}: there is no pyproject.toml; name the source tree", file=sys.stderr
        )
        return 1
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(options.source, tree, ignore=shutil.ignore_patterns(*_LEFT_OUT))
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
        command += ["--wheel-dir", str(options.output), str(tree)]
        done = subprocess.run(command, check=False)
    if done.returncode != 0:
        print("the wheel could not be built; see above", file=sys.stderr)
        return 1
    wheel = max(options.output.glob("fieldlink-*.whl"), key=lambda path: path.stat().st_mtime)
    missing = missing_plants(wheel)
    if missing:
        print(f"{wheel}: it lacks {', '.join(missing)}", file=sys.stderr)
        return 1
    print(f"{wheel} ({wheel.stat().st_size / 1024:.0f} kB, {len(catalogue)} plants)")
    return 0


def missing_plants(wheel: Path) -> list[str]:
    """Return the FMUs that a wheel should carry and does not."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    wanted = [
        f"fmu_models/binaries/{target_file(n, v).name}" for n in catalogue for v in FMI_VERSIONS
    ]
    return [name for name in wanted if name not in names]


if __name__ == "__main__":
    raise SystemExit(main())
