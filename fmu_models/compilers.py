"""A C compiler: the machine's own where there is one, else zig from PyPI."""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from .describe import FmiVersion
from .errors import PlantBuildError

__all__ = ["PLATFORMS", "Platform", "compile_library", "host_platform"]


@dataclass(frozen=True, slots=True)
class Platform:
    """A platform that an FMU can carry a library for.

    Attributes:
        fmi3: its folder under ``binaries`` in FMI 3.
        fmi2: its folder in FMI 2, None where FMI 2 has none (ARM).
        suffix: of a shared library.
        zig: its name for ``zig cc -target``.
    """

    fmi3: str
    fmi2: str | None
    suffix: str
    zig: str

    def folder(self, version: FmiVersion) -> str | None:
        """Return its folder under ``binaries`` in FMI ``version``, None where it has none."""
        return self.fmi2 if version == 2 else self.fmi3


PLATFORMS: tuple[Platform, ...] = (
    # glibc 2.17 is what manylinux2014 asks for: it runs on everything since 2014.
    Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
    Platform("aarch64-linux", None, ".so", "aarch64-linux-gnu.2.17"),
    Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
    Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
    Platform("aarch64-darwin", None, ".dylib", "aarch64-macos"),
)

_FLAGS = ("-std=c11", "-O2", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-Wall")


def host_platform() -> Platform:
    """Return the platform of this interpreter.

    Raises:
        PlantBuildError: it is none of `PLATFORMS`.
    """
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    name = f"{machine}-{platform.system().lower()}"
    for candidate in PLATFORMS:
        if candidate.fmi3 == name:
            return candidate
    raise PlantBuildError(
        f"plants are not built for {name}; known are {', '.join(p.fmi3 for p in PLATFORMS)}"
    )


def _command(target: Platform) -> list[str]:
    own = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if own and target == host_platform() and target.suffix != ".dll":
        return shlex.split(own)
    if importlib.util.find_spec("ziglang") is None:
        what = (
            "no C compiler was found" if target == host_platform() else "cross-building needs zig"
        )
        raise PlantBuildError(
            f"cannot build for {target.fmi3}: {what}; install one "
            f"(cc, gcc or clang), or zig from PyPI: {sys.executable} -m pip install ziglang"
        )
    return [sys.executable, "-m", "ziglang", "cc", "-target", target.zig]


def compile_library(
    source: Path, includes: tuple[Path, ...], output: Path, target: Platform
) -> None:
    """Compile one C file into the shared library ``output``.

    Raises:
        PlantBuildError: no compiler, or it refused the source; its words are in the message.
    """
    command = _command(target)
    command += _FLAGS
    if target.suffix != ".dll":
        command.append("-fPIC")
    for folder in includes:
        command += ["-I", str(folder)]
    command += [str(source), "-o", str(output)]
    if target.suffix == ".so":
        command.append("-lm")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PlantBuildError(
            f"the compiler could not be run: {shlex.join(command)}: {error}"
        ) from error
    if done.returncode != 0:
        raise PlantBuildError(
            f"compiling {source.name} for {target.fmi3} failed (exit status {done.returncode}):\n"
            f"{shlex.join(command)}\n{done.stderr.strip()[-4000:]}"
        )
