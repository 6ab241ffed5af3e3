"""A day of many loops, sampled every second, as ``fieldlink diagnose FOLDER`` reads it.

Simulated loops of every cause are written as CSV files and diagnosed together, groups included. A
few different days are linked under many names, so that the disk holds little; every name is read
and diagnosed on its own. With fewer loops than a plant has, the time of 500 on two free cores is
extrapolated from processor time, which other programs on the machine change little: loops cost
alike, and the search for groups is small beside them.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import pandas as pd

from benchmarks.diagnosis_families import tuning
from benchmarks.diagnosis_families.records import CAUSES
from benchmarks.report import heading, keep, table
from fieldlink.diagnosing import Columns, diagnose_files

DAY = 86_400
PLANT = 500
"""Loops of the plant whose day must take less than ten minutes."""


def write_loops(folder: Path, names: int, days: int, samples: int) -> dict[str, Path]:
    """Write ``days`` different loops and link them under ``names`` names."""
    files: dict[str, Path] = {}
    for number in range(min(days, names)):
        cause = CAUSES[number % len(CAUSES)]
        loop = tuning.draw_loop((cause,), 5000 + number, samples=samples)
        path = folder / f"day{number}.csv"
        auto = loop.auto.astype(int)
        frame = pd.DataFrame({"op": loop.op, "pv": loop.pv, "sp": loop.sp, "auto": auto})
        frame.round(4).to_csv(path, index=False)
    for number in range(names):
        link = folder / f"LC{number:04d}.csv"
        link.symlink_to(folder / f"day{number % days}.csv")
        files[link.stem] = link
    return files


def _processor_seconds() -> float:
    """Of this process and the workers that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table; write it with ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=500)
    parser.add_argument("--days", type=int, default=27, help="different ones")
    parser.add_argument("--samples", type=int, default=DAY)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as place:
        files = write_loops(Path(place), options.loops, options.days, options.samples)
        begun, busy = perf_counter(), _processor_seconds()
        plant = diagnose_files(files, Columns(period=1.0))
        seconds, busy = perf_counter() - begun, _processor_seconds() - busy
    memory = [
        resource.getrusage(who).ru_maxrss / 1024.0
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    rows = [
        ["loops", f"{len(plant.loops)} of {options.samples} samples"],
        ["groups", f"{len(plant.groups)}"],
        ["seconds", f"{seconds:.0f} on {os.cpu_count()} cores"],
        [
            "processor seconds for each loop",
            f"{busy / options.loops:.2f}",
        ],
        [
            f"minutes for {PLANT} loops on two cores"
            + ("" if options.loops == PLANT else ", extrapolated"),
            f"{busy / options.loops * PLANT / 2.0 / 60.0:.1f}",
        ],
        ["most memory of the main process", f"{memory[0]:.0f} MB"],
        ["most memory of a worker", f"{memory[1]:.0f} MB"],
    ]
    text = "\n\n".join(
        [heading("diagnosis_day", __doc__, arguments), table(["figure", "value"], rows)]
    )
    print(text)
    keep(options.out, "diagnosis_day", text,
         {"seconds": seconds, "processor_seconds": busy, "memory_mb": memory})  # fmt: skip


if __name__ == "__main__":
    main()
