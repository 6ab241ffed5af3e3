"""Examples 1 and 2 of the paper: the search, the paper's optimisation and its grid in one run.

    python -m benchmarks.paper [--runs 3] [--out docs/benchmarks]
    python -m benchmarks.paper --runs 120 --methods search truth oracle

Every method gets the same windows: 1,000 samples under the paper's unaware MPC, its noise levels,
begun in mid-cycle, with set-point changes as in the paper's data, and the same loops at constant
set-point, where J and the gain are harder to tell. All costs are in one currency
(`paper_methods`): equation (12) of ARX(3,3) with intercept, the first position of the stem by one
rule for all. The grid and the optimisation minimise that cost themselves, with the paper's own
first positions; they are given the orders and the dead time, which the search has to find.

A search that leaves a higher cost than the true valve has missed its optimum. The oracle is given
the samples at which the true valve moves, and fits the rest by least squares: what remains of its
errors is what the data leave open. With one move of the stem a stroke the gain
and J trade against each other through the size of the moves, and with a free intercept nothing
else settles the gain. The paper's model has no intercept, OP and PV share one zero: then the means
of stem and PV settle it, as the second oracle shows. A plant rarely grants that.

The first table holds the search against its limits. A share of twenty windows is known to some ten
percent only: coverage is judged by more.

Seconds are those of one core, medians of one run on one machine: only ratios mean anything.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, astuple
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.examples import EXAMPLES, Example, example_window
from benchmarks.paper_methods import METHODS, Estimate, estimates
from benchmarks.paper_summary import CONSTANT, HEADER, Summary, held, published, summarise
from benchmarks.report import heading, keep, machine, table
from estimator import warm_up
from loop_model import LoopModel

__all__ = ["main"]


def _plain(one: Estimate) -> dict[str, Any]:
    return {**asdict(one), "poles": [[pole.real, pole.imag] for pole in one.poles]}


def _of_window(
    options: argparse.Namespace, example: Example, constant: bool, seed: int
) -> list[Estimate]:
    return estimates(
        example,
        example_window(example, seed, samples=options.samples, constant=constant),
        methods=options.methods,
        criteria=options.criteria,
        grid_step=options.grid_step,
        starts=options.starts,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="windows of each example")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first window")
    parser.add_argument("--samples", type=int, default=1000, help="samples of a window")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument(
        "--criteria", nargs="+", default=["auto", "arx"], help="criteria of the search"
    )
    parser.add_argument("--jobs", type=int, default=1, help="windows side by side")
    parser.add_argument(
        "--grid-step", type=float, default=0.1, help="step of the paper's grid, in units of OP"
    )
    parser.add_argument("--starts", type=int, default=7, help="M of the paper's optimisation")
    parser.add_argument("--name", default="paper", help="name of the files in --out")
    parser.add_argument("--out", type=Path, help="folder for the table and the figures")
    options = parser.parse_args(arguments)
    rows: list[Summary] = []
    every: list[dict[str, Any]] = []
    seeds = range(options.seed, options.seed + options.runs)
    with ProcessPoolExecutor(options.jobs, get_context("spawn"), warm_up) as pool:
        for example, constant in product(EXAMPLES, (False, True)):
            name = f"{example.name}, {CONSTANT}" if constant else example.name
            windows = list(pool.map(partial(_of_window, options, example, constant), seeds))
            for seed, found in zip(seeds, windows, strict=True):
                every += [{"example": name, "seed": seed, **_plain(one)} for one in found]
            rows += summarise(name, LoopModel(example.valve, example.process), windows)
            if not constant:
                rows.append(published(example))
    head = heading("paper", __doc__, arguments)
    limits = table(("example", "figure", "reached", "limit", "met"), held(rows))
    text = f"{head}\n\n{limits}\n\n{table(HEADER, [astuple(row) for row in rows])}"
    print(text)
    figures = {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "summary": [asdict(row) for row in rows],
        "windows": every,
    }
    keep(options.out, options.name, text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
