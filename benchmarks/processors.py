"""Settings under which Numba, OpenBLAS and NumPy work as on another processor.

``python -m benchmarks.processors -- COMMAND...`` runs a command, for instance ``make test``, under
each named setting, one after the other, and prints setting and exit status; ``--settings`` takes
some of them. What this processor lacks is printed and not run. The exit status is 1 where a
run failed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Mapping, Sequence

import numpy as np

__all__ = ["SETTINGS", "environment_of", "lacking", "main"]

_HASWELL = "+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse3,+sse4.1,+sse4.2,+ssse3"


def _has(feature: str) -> bool:
    """Whether NumPy finds a feature in this processor."""
    return bool(np._core._multiarray_umath.__cpu_features__.get(feature, False))


def _dispatched(first: str) -> str:
    """NumPy's optional instruction sets from ``first`` on that this processor has.

    Their names are those of the NumPy that is installed: others are ignored with a warning.
    """
    names = list(np._core._multiarray_umath.__cpu_dispatch__)
    begin = names.index(first) if first in names else len(names)
    return " ".join(name for name in names[begin:] if _has(name))


SETTINGS: Mapping[str, Mapping[str, str]] = {
    "native": {},
    "generic": {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": _dispatched("X86_V3"),
    },
    "haswell": {
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": _HASWELL,
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": _dispatched("X86_V4"),
    },
    "skylakex": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
"""Name and features of the processor that Numba, OpenBLAS and NumPy work for. Numba's name alone
changes nothing: its features are the machine's unless they are given."""

_NEEDED = {"haswell": "AVX2", "skylakex": "AVX512F"}


def environment_of(setting: str) -> dict[str, str]:
    """This process's environment under a setting, and nothing of another one."""
    of_settings = {name for one in SETTINGS.values() for name in one}
    rest = {name: value for name, value in os.environ.items() if name not in of_settings}
    return rest | dict(SETTINGS[setting])


def lacking(setting: str) -> str | None:
    """The instruction set that a setting needs and this processor lacks; None where it can run."""
    needed = _NEEDED.get(setting)
    return None if needed is None or _has(needed) else needed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command under each setting; exit code 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--settings", nargs="*", default=list(SETTINGS), choices=list(SETTINGS))
    parser.add_argument("command", nargs="+", help="what to run, after --")
    options = parser.parse_args(arguments)
    failed = 0
    for setting in options.settings:
        if (needed := lacking(setting)) is not None:
            print(f"{setting}: not run, this processor has no {needed}", flush=True)
            continue
        done = subprocess.run(options.command, env=environment_of(setting), check=False)
        print(f"{setting}: exit status {done.returncode}", flush=True)
        failed += done.returncode != 0
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
