"""Build the catalogue's FMUs from source: ``python -m fmu_models.build``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .compilers import PLATFORMS, host_platform
from .errors import PlantBuildError
from .packing import (
    BINARIES,
    FMI_VERSIONS,
    build,
    build_source,
    is_current,
    model_names,
    target_file,
)

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Build all or some models; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m fmu_models.build", description=main.__doc__)
    parser.add_argument(
        "models",
        nargs="*",
        metavar="MODEL",
        help="plants of the catalogue or C files of your own; the whole catalogue unless given",
    )
    parser.add_argument("--output", type=Path, default=BINARIES, help="folder of the .fmu files")
    parser.add_argument(
        "--force", action="store_true", help="build also the files that are current"
    )
    parser.add_argument(
        "--all-platforms",
        action="store_true",
        help="Linux (x86-64, ARM), Windows and macOS in each file, with zig (pip install ziglang)",
    )
    options = parser.parse_args(arguments)
    try:
        platforms = PLATFORMS if options.all_platforms else (host_platform(),)
        versions = [v for v in FMI_VERSIONS if host_platform().folder(v) is not None]
        for name in options.models or model_names():
            if name.endswith(".c"):
                _tell(build_source(Path(name), platforms=platforms, output=options.output))
                continue
            files = [options.output / target_file(name, v).name for v in versions]
            if not (options.force or options.all_platforms) and all(
                is_current(file, name, v) for file, v in zip(files, versions, strict=True)
            ):
                print(f"{name}: current")
                continue
            _tell(build(name, platforms=platforms, output=options.output))
    except PlantBuildError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _tell(built: tuple[Path, ...]) -> None:
    for path in built:
        print(f"{path} ({path.stat().st_size / 1024:.0f} kB)")


if __name__ == "__main__":
    raise SystemExit(main())
