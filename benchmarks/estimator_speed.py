"""How fast the estimator is on one core.

    python -m benchmarks.estimator_speed [--out docs/benchmarks]

Candidate-samples per second of the compiled criteria (valve, process, least squares: everything
that a candidate costs) beside one bare fused multiply-add for each of them (`bare_loops`), seconds
a window with everything included (orders, intervals, verdict) over windows of four kinds (both
examples; the sticky and the healthy loops of `robustness`), and the time of the paper's grid and of
its optimisation over the search's, on the same window in the same run. Seconds are processor
seconds; only ratios mean anything.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.bare_loops import in_cache, streamed
from benchmarks.examples import EXAMPLES, example_window
from benchmarks.loops import named_loop
from benchmarks.recording import record
from benchmarks.report import heading, keep, machine, table
from estimator import grid_search, identify, nlp_paper, warm_up
from estimator._one_step import one_step_costs
from estimator._simulated import simulated_costs
from estimator._slips import op_of
from estimator.arx import ArxOrders, ArxRegression
from estimator.regression import Regression
from estimator.structures import Structure
from estimator.window import harmonise

__all__ = ["least_seconds", "main"]

_LANES = 1024
_ORDERS: dict[str, Any] = {"na": 3, "nb": 3}


def least_seconds(action: Callable[[], object], repeats: int) -> float:
    """Least processor seconds of ``action`` over ``repeats`` runs."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        action()
        spent.append(time.process_time() - begun)
    return min(spent)


def _kernels(op: np.ndarray, pv: np.ndarray) -> dict[str, float]:
    """Candidate-samples per second, and what of the bare loops that is.

    The kernels walk from slip to slip, not from sample to sample: a candidate counts all samples of
    the window all the same, because that is what it is judged by.
    """
    window = harmonise(op, pv, None, None, 1.0)
    u = op_of(window.u)
    simulated = Regression(window.y, window.good).tables(Structure.of_time_constants(6.0, 2.0))
    one_step = ArxRegression(window.y, window.good, ArxOrders(3, 3, 1)).tables
    band = np.linspace(0.2, 0.95, _LANES)
    nodes = np.column_stack([band, band * np.linspace(0.1, 0.9, _LANES), 0.5 * band])
    stem, total = np.zeros((window.size, _LANES)), np.zeros(_LANES)
    out = np.zeros_like(stem)
    calls: dict[str, tuple[int, Callable[[], object]]] = {
        "simulated, one dead time": (1, lambda: simulated_costs(u, simulated, nodes, 1.0, 1, 1)),
        "simulated, 12 dead times": (12, lambda: simulated_costs(u, simulated, nodes, 1.0, 0, 12)),
        "one step, arx(3,3)": (1, lambda: one_step_costs(u, one_step, nodes, 1.0)),
        "bare multiply-add, streamed": (1, lambda: streamed(stem, 0.9, out)),
        "bare multiply-add, in cache": (1, lambda: in_cache(window.u, band, total)),
    }
    work = float(stem.size)
    rates = {name: n * work / least_seconds(call, 15) for name, (n, call) in calls.items()}
    figures = {f"{name}, candidate-samples per second": rate for name, rate in rates.items()}
    for name in ("simulated, one dead time", "simulated, 12 dead times", "one step, arx(3,3)"):
        for bare in ("streamed", "in cache"):
            figures[f"{name}, over bare {bare}"] = rates[name] / rates[f"bare multiply-add, {bare}"]
    return figures


def _windows(samples: int, repeats: int, each: int) -> dict[str, float]:
    """Seconds a window, mean and slowest, of ``each`` windows of four kinds."""
    kinds: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for example in EXAMPLES:
        traces = [example_window(example, seed, samples=samples) for seed in range(each)]
        kinds[example.name] = [(trace.op, trace.pv) for trace in traces]
    for letter, kind in (("s", "sticky loops"), ("h", "healthy loops")):
        loops = [record(named_loop(f"{letter}{i}"), samples=samples) for i in range(each)]
        kinds[kind] = [(loop.op, loop.pv) for loop in loops]
    figures, total = {}, 0.0
    for name, windows in kinds.items():
        spent = [least_seconds(partial(identify, *window), repeats) for window in windows]
        figures[f"{name}, mean seconds a window"] = float(np.mean(spent))
        figures[f"{name}, slowest of {each}"] = max(spent)
        total += sum(spent)
    figures["windows per second, mean"] = each * len(kinds) / total
    return figures


def _rivals(samples: int, grid_step: float, starts: int) -> dict[str, float]:
    """Seconds of the paper's methods on Example 1, and over the search's."""
    trace = example_window(EXAMPLES[0], 1, samples=samples)
    op, pv = trace.op, trace.pv
    search = least_seconds(partial(identify, op, pv), 10)
    found = {"search, seconds": search}
    calls: dict[str, Callable[[], object]] = {
        f"grid {grid_step:g}": partial(grid_search, op, pv, **_ORDERS, step=grid_step)
    }
    if starts:
        first = partial(nlp_paper, op, pv, **_ORDERS, starts=starts, initial=("first",))
        calls[f"nlp M={starts}"] = first
    for name, call in calls.items():
        seconds = least_seconds(call, 1)
        found[f"{name}, seconds"] = seconds
        found[f"{name} over search"] = seconds / search
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1000, help="of a window")
    parser.add_argument("--windows", type=int, default=20, help="of each kind")
    parser.add_argument("--repeats", type=int, default=3, help="of a window; the least counts")
    parser.add_argument("--grid-step", type=float, default=0.1, help="of the paper's grid")
    parser.add_argument("--starts", type=int, default=7, help="M of the optimisation; 0: without")
    parser.add_argument("--out", type=Path, help="folder for estimator_speed.md and .json")
    options = parser.parse_args(arguments)
    warm_up()
    trace = example_window(EXAMPLES[0], 1, samples=options.samples)
    with threadpool_limits(limits=1):
        figures = {
            **_kernels(trace.op, trace.pv),
            **_windows(options.samples, options.repeats, options.windows),
            **_rivals(options.samples, options.grid_step, options.starts),
        }
    head = heading("estimator_speed", __doc__, arguments)
    text = f"{head}\n\n{table(('figure', 'value'), list(figures.items()))}"
    print(text)
    kept = {k: v for k, v in vars(options).items() if k != "out"}
    keep(options.out, "estimator_speed", text, {"options": kept, "machine": machine(), **figures})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
