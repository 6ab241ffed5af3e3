"""How long the estimator takes on one core, kind by kind, and how long the paper's methods take.

    python -m benchmarks.estimator_speed [--out docs/benchmarks]

Milliseconds of a window with everything included (search, verdict, intervals), mean and slowest
over windows of each kind: the paper's two examples with set-point changes and at constant
set-point, and loops of the tuning family, sticky and healthy, under PI control, with an integrating
process and with an oscillatory one. Then the paper's grid and its optimisation on windows of both
examples, over the time of the estimator on the same windows in the same run. All times are
processor time of one core; the least of a few runs counts. Only ratios mean anything elsewhere.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.examples import EXAMPLES, example_window
from benchmarks.families.tuning import draw
from benchmarks.report import heading, keep, machine, table
from estimator import Identification, grid_search, identify, nlp_paper, warm_up

__all__ = ["FAMILY_KINDS", "HEALTHY_LIMIT_MS", "LIMIT_MS", "least_seconds", "main"]

Array = NDArray[np.float64]
Call = Callable[[], Identification]

FAMILY_KINDS = ("pi", "integrating", "oscillatory")
"""Kinds of the tuning family that are timed, sticky and healthy."""

LIMIT_MS = 60.0
"""Mean of every kind of window, asked for."""
HEALTHY_LIMIT_MS = 25.0
"""Mean of every kind of healthy loop, asked for."""

_ORDERS: dict[str, Any] = {"na": 3, "nb": 3}
_SEARCH_RUNS = 3


@dataclass(frozen=True, slots=True)
class Kind:
    """Times of the windows of one kind, in milliseconds of one core."""

    name: str
    windows: int
    samples: float
    mean_ms: float
    slowest_ms: float
    called_sticky: int
    limit_ms: float


@dataclass(frozen=True, slots=True)
class Rival:
    """One of the paper's methods on windows of an example, and its time over the estimator's."""

    example: str
    method: str
    windows: int
    seconds: float
    over_ours: float


def least_seconds(action: Callable[[], object], repeats: int) -> float:
    """Least processor seconds of ``action`` over ``repeats`` runs."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        action()
        spent.append(time.process_time() - begun)
    return min(spent)


def _windows(samples: int, each: int) -> dict[str, tuple[float, list[tuple[int, Call]]]]:
    """Return by kind of window its limit, and the samples and identification of each window."""
    kinds: dict[str, tuple[float, list[tuple[int, Call]]]] = {}
    for example in EXAMPLES:
        for constant in (False, True):
            traces = [
                example_window(example, seed, samples=samples, constant=constant)
                for seed in range(each)
            ]
            name = f"{example.name}, constant set-point" if constant else example.name
            kinds[name] = LIMIT_MS, [(t.op.size, partial(identify, t.op, t.pv)) for t in traces]
    for kind in FAMILY_KINDS:
        for sticky in (True, False):
            loops = [draw(kind, sticky, seed) for seed in range(each)]
            calls: list[tuple[int, Call]] = [
                (loop.op.size, partial(identify, loop.op, loop.pv, sp=loop.sp, period=loop.period))
                for loop in loops
            ]
            name = f"{kind}, {'sticky' if sticky else 'healthy'}"
            kinds[name] = (LIMIT_MS if sticky else HEALTHY_LIMIT_MS), calls
    return kinds


def _measure(name: str, limit: float, windows: Sequence[tuple[int, Call]], repeats: int) -> Kind:
    spent = [1e3 * least_seconds(call, repeats) for _, call in windows]
    return Kind(
        name=name,
        windows=len(windows),
        samples=float(np.mean([samples for samples, _ in windows])),
        mean_ms=float(np.mean(spent)),
        slowest_ms=max(spent),
        called_sticky=sum(call().verdict.value == "stiction" for _, call in windows),
        limit_ms=limit,
    )


def _rivals(samples: int, each: int, grid_step: float, starts: int) -> list[Rival]:
    """The paper's methods on the first windows of both examples."""
    found = []
    for example in EXAMPLES:
        traces = [example_window(example, seed, samples=samples) for seed in range(each)]
        windows = [(trace.op, trace.pv) for trace in traces]
        ours = [least_seconds(partial(identify, *window), _SEARCH_RUNS) for window in windows]
        calls: dict[str, Callable[[Array, Array], object]] = {
            f"grid {grid_step:g}": partial(grid_search, **_ORDERS, step=grid_step)
        }
        if starts:
            calls[f"optimisation, M={starts}"] = partial(
                nlp_paper, **_ORDERS, starts=starts, initial=("first",)
            )
        for name, call in calls.items():
            spent = [least_seconds(partial(call, *window), 1) for window in windows]
            ratio = sum(spent) / sum(ours)
            found.append(Rival(example.name, name, each, float(np.mean(spent)), ratio))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--samples", type=int, default=1000, help="samples of a window of the examples"
    )
    parser.add_argument("--windows", type=int, default=20, help="windows of each kind")
    parser.add_argument(
        "--repeats", type=int, default=3, help="runs of a window, of which the quickest counts"
    )
    parser.add_argument(
        "--rival-windows",
        type=int,
        default=2,
        help="windows of each example for the published methods",
    )
    parser.add_argument("--grid-step", type=float, default=0.1, help="step of the paper's grid")
    parser.add_argument("--starts", type=int, default=7, help="M of the optimisation; 0: without")
    parser.add_argument("--out", type=Path, help="folder for estimator_speed.md and .json")
    options = parser.parse_args(arguments)
    warm_up()
    with threadpool_limits(limits=1):
        kinds = [
            _measure(name, limit, windows, options.repeats)
            for name, (limit, windows) in _windows(options.samples, options.windows).items()
        ]
        rivals = _rivals(options.samples, options.rival_windows, options.grid_step, options.starts)
    times = table(
        ("kind", "windows", "samples", "mean ms", "slowest ms", "called sticky", "limit, mean ms"),
        [tuple(asdict(kind).values()) for kind in kinds],
    )
    ratios = table(
        ("example", "method", "windows", "seconds a window", "over the estimator's"),
        [tuple(asdict(rival).values()) for rival in rivals],
    )
    parts = [heading("estimator_speed", __doc__, arguments), "## Milliseconds of one core", times]
    parts += ["## The paper's methods on the same windows", ratios]
    text = "\n\n".join(parts)
    print(text)
    figures = {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "kinds": [asdict(kind) for kind in kinds],
        "rivals": [asdict(rival) for rival in rivals],
    }
    keep(options.out, "estimator_speed", text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
