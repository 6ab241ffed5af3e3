"""Monte Carlo over loops of many kinds: bias and spread of S, coverage, false alarms, misses.

    python -m benchmarks.robustness [--runs 200] [--seed 0] [--jobs 2] [--out docs/benchmarks]
    python -m benchmarks.robustness --loop h17 [--csv h17.csv]

As many healthy loops as sticky ones are judged. A sticky valve that the window does not show
(the estimator says so, with a reason) counts as not assessable, never as a miss. Every false alarm
and every miss is listed with the command that shows it alone.

Choudhury's valve counts its band anew at every turn of OP, so under a noisy OP it really sticks for
much more than its S: its rows show how far apart the published models are, not an error of the
estimate. They are left out of the errors and coverages of all other rows.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.judgement import Judgement, judge
from benchmarks.loops import FMU_PLANTS, Loop, draw_loop, named_loop
from benchmarks.recording import record
from benchmarks.report import heading, keep, machine
from benchmarks.robustness_table import tables
from estimator import warm_up
from fmu_models import fmu_path

__all__ = ["judge_all", "main"]


def judge_all(loops: Sequence[Loop], *, samples: int, jobs: int) -> list[Judgement]:
    """Judge every loop, in order; the answers do not depend on ``jobs``."""
    # A process that finds an FMU stale would build it while its neighbour does.
    for name in FMU_PLANTS:
        fmu_path(name)
    one = partial(judge, samples=samples)
    if jobs == 1:
        warm_up()
        return _counted(map(one, loops), len(loops))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=warm_up) as pool:
        return _counted(pool.map(one, loops, chunksize=4), len(loops))


def _counted(judged: Iterable[Judgement], total: int) -> list[Judgement]:
    found = []
    for one in judged:
        found.append(one)
        if len(found) % 50 == 0:
            print(f"{len(found)} of {total} loops", flush=True)
    return found


def _show(name: str, samples: int, csv: Path | None) -> int:
    """Print one loop and what the estimator says about it; ``csv`` keeps its window."""
    loop = named_loop(name)
    print(json.dumps(asdict(judge(loop, samples=samples)), indent=2))
    if csv is not None:
        window = record(loop, samples=samples)
        columns = np.column_stack([window.op, window.pv, window.sp, window.stem])
        np.savetxt(csv, columns, delimiter=",", header="op,pv,sp,stem", comments="")
        print(f"window: {csv}; fieldlink identify {csv} --sp sp")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="sticky loops; as many healthy")
    parser.add_argument("--seed", type=int, default=0, help="of the first loop")
    parser.add_argument("--samples", type=int, default=1000, help="of a window")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--loop", metavar="NAME", help="one loop alone: s17 or h17")
    parser.add_argument("--csv", type=Path, help="with --loop: keep its window here")
    parser.add_argument("--loops", type=Path, help="keep every judgement here, one JSON a line")
    parser.add_argument("--out", type=Path, help="folder for robustness.md and robustness.json")
    options = parser.parse_args(arguments)
    if options.loop is not None:
        return _show(options.loop, options.samples, options.csv)
    seeds = range(options.seed, options.seed + options.runs)
    loops = [draw_loop(seed, healthy=healthy) for healthy in (False, True) for seed in seeds]
    judged = judge_all(loops, samples=options.samples, jobs=options.jobs)
    body, figures = tables(judged, samples=options.samples)
    text = f"{heading('robustness', __doc__, arguments)}\n\n{body}"
    print(text)
    kept = {
        "options": {k: v for k, v in vars(options).items() if k in ("runs", "seed", "samples")},
        "machine": machine(),
        **figures,
    }
    if options.loops is not None:
        lines = [json.dumps({"name": one.loop.name, **asdict(one)}) for one in judged]
        options.loops.write_text("\n".join(lines) + "\n")
    keep(options.out, "robustness", text, kept)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
