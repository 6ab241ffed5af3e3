"""What Dask costs beside the local pool: processor seconds at two sizes, start and slope apart.

    python -m benchmarks.dask_overhead [--windows 120 480] [--samples 200] [--out docs/benchmarks]

The command `fieldlink assess` is run with two workers on the local pool and on a Dask cluster of
this machine, on fleets of two sizes (as in `benchmarks.assess_fleet`). A cluster costs something
once, to start, and something for each window. Two sizes tell the two apart: a straight line through
both gives the seconds at the start and the seconds a window, and with them the overhead at 2,000
windows. Seconds are processor seconds of all processes; what else the machine does is not in them.
Short windows make the share of Dask larger than it is for longer ones.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.assess_runs import Run, run_assess, write_fleet
from benchmarks.report import heading, keep, machine, table

LARGE = 2_000
"""Number of windows for which the overhead is reported."""

DAYS = 10
"""Windows of a loop."""

ENGINES = (("local", ()), ("Dask", ("--engine", "dask")))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--windows", type=int, nargs=2, default=(120, 480))
    parser.add_argument("--samples", type=int, default=200, help="samples of a window")
    parser.add_argument("--out", type=Path, help="folder for dask_overhead.md and .json")
    given = parser.parse_args(arguments)
    small, large = sorted(given.windows)
    runs: dict[str, list[Run]] = {name: [] for name, _ in ENGINES}
    with tempfile.TemporaryDirectory(prefix="fleet") as folder:
        root = Path(folder)
        for windows in (small, large):
            fleet = root / f"fleet {windows}"
            fleet.mkdir()
            write_fleet(fleet, windows, given.samples, DAYS)
            for name, options in ENGINES:
                out = root / f"{name} {windows}"
                chosen = ("--workers", "2", *options)
                runs[name].append(run_assess(name, fleet, out, given.samples, *chosen))
    text = "\n\n".join([heading("dask_overhead", __doc__, arguments), _texts(runs)])
    print(text)
    figures = {name: [asdict(run) for run in found] for name, found in runs.items()}
    keep(given.out, "dask_overhead", text, {"machine": machine(), "runs": figures})
    return 0


def _line(runs: Sequence[Run]) -> tuple[float, float]:
    """Processor seconds at the start, and a window."""
    first, last = runs
    slope = (last.cpu - first.cpu) / (last.windows - first.windows)
    return first.cpu - slope * first.windows, slope


def _texts(runs: dict[str, list[Run]]) -> str:
    lines = {name: _line(found) for name, found in runs.items()}
    measured = table(
        ("engine", "windows", "processor s", "seconds", "most MB"),
        [
            (name, run.windows, run.cpu, run.seconds, run.megabytes)
            for name, found in runs.items()
            for run in found
        ],
    )
    apart = table(
        ("engine", "processor s at the start", "processor ms a window"),
        [(name, start, 1000.0 * slope) for name, (start, slope) in lines.items()],
    )
    (start, slope), (dask_start, dask_slope) = (lines[name] for name, _ in ENGINES)
    at_large = 100.0 * ((dask_start + LARGE * dask_slope) / (start + LARGE * slope) - 1.0)
    words = (
        f"Dask over local: {dask_start - start:+.1f} s at the start and "
        f"{100.0 * (dask_slope / slope - 1.0):+.1f} % a window; on these lines {at_large:+.1f} % "
        f"of the processor seconds at {LARGE:,} windows of this length."
    )
    return "\n\n".join([measured, apart, words])


if __name__ == "__main__":
    raise SystemExit(main())
