"""Examples 1 and 2 of the paper: the search, the paper's optimisation and its grid in one run.

    python -m benchmarks.paper [--runs 20] [--grid-step 0.5] [--out docs/benchmarks]

Every method gets the same windows. Costs are compared in one currency: equation (12) of an
ARX(3,3) with intercept behind He's valve, theta by least squares (`estimator.paper_fit`). Seconds
are medians of one run on one machine and mean something only as ratios.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.examples import EXAMPLES, Example, ExampleWindow, example_window
from benchmarks.report import keep, machine, table
from estimator import identify, warm_up
from estimator.grid import grid_search
from estimator.moves import best_with_same_moves
from estimator.nlp import nlp_paper, nlp_polish
from estimator.paper_fit import ArxStructure, ArxWindow, PaperFit
from estimator.valves import HeValve
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = ["Estimate", "Summary", "main", "summarise"]

_ORDERS: dict[str, Any] = {"na": 3, "nb": 3, "dead_time": 1}
_CONFIDENCE = 0.9

Band = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """What one method says about one window."""

    method: str
    stick_band: float
    slip_jump: float
    gain: float
    slowest_pole: float
    cost: float
    seconds: float
    stem0: float
    verdict: str = ""
    stick_band_interval: Band | None = None
    slip_jump_interval: Band | None = None
    gain_interval: Band | None = None


@dataclass(frozen=True, slots=True)
class Summary:
    """One method over all windows of one example; errors are medians of absolute relative errors.

    ``coverage_*`` is the share of intervals that hold the truth, ``search_no_worse`` the share
    of windows in which the search's cost is at most the method's, ``time_ratio`` its median
    seconds over the search's.
    """

    example: str
    method: str
    windows: int
    static_friction: float
    dynamic_friction: float
    stick_band: float
    stick_band_p90: float
    slip_jump: float
    gain: float
    slowest_pole: float
    coverage_stick_band: float
    coverage_slip_jump: float
    coverage_gain: float
    search_no_worse: float
    time_ratio: float


def _slowest_pole(process: ProcessModel) -> float:
    roots = np.roots([1.0, *process.a])
    return float(np.abs(roots).max()) if roots.size else 0.0


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.perf_counter()
    answer = call()
    return answer, time.perf_counter() - begun


def _of_fit(method: str, fit: PaperFit, cost: float, seconds: float) -> Estimate:
    return Estimate(
        method=method,
        stick_band=fit.valve.stick_band,
        slip_jump=fit.valve.slip_jump,
        gain=fit.process.gain,
        slowest_pole=_slowest_pole(fit.process),
        cost=cost,
        seconds=seconds,
        stem0=fit.stem0,
    )


def _of_search(window: ExampleWindow, currency: ArxWindow, criterion: str) -> Estimate:
    result, seconds = _timed(
        lambda: identify(window.op, window.pv, criterion=criterion, confidence=_CONFIDENCE)
    )
    process = None if result.model is None else result.model.process
    gain = result.process.gain_interval if result.process is not None else None
    return Estimate(
        method=f"search, {criterion}",
        stick_band=result.stick_band.value,
        slip_jump=result.slip_jump.value,
        gain=math.nan if gain is None else gain.value,
        slowest_pole=math.nan if process is None else _slowest_pole(process),
        cost=math.nan if process is None else currency.solve(result.stem)[1],
        seconds=seconds,
        stem0=math.nan if process is None else float(result.stem[0]),
        verdict=result.verdict.value,
        stick_band_interval=(result.stick_band.low, result.stick_band.high),
        slip_jump_interval=(result.slip_jump.low, result.slip_jump.high),
        gain_interval=None if gain is None else (gain.low, gain.high),
    )


def estimates(
    example: Example,
    window: ExampleWindow,
    *,
    grid_step: float,
    criteria: Sequence[str],
    starts: int = 7,
) -> list[Estimate]:
    """All methods on one window; the first is the search with the first of ``criteria``."""
    currency = ArxWindow.of(window.op, window.pv, ArxStructure(**_ORDERS))
    found = [_of_search(window, currency, criterion) for criterion in criteria]

    def cost(fit: PaperFit) -> float:
        return currency.solve(fit.stem)[1]

    # What anyone could reach who knew when the valve moves: the floor of every error.
    truth = HeValve(example.valve.stick_band, example.valve.slip_jump)
    known = best_with_same_moves(currency, currency.fit(truth, float(window.stem[0])))
    found.append(_of_fit("oracle: the true moves", known, known.cost, math.nan))

    # The paper has no intercept, and its examples, whose OP and PV share one zero, need none.
    paper, seconds = _timed(
        lambda: nlp_paper(window.op, window.pv, **_ORDERS, starts=starts, intercept=False)
    )
    found.append(_of_fit(f"nlp, paper, M={starts} twice", paper.best, cost(paper.best), seconds))
    best = found[0]
    if math.isfinite(best.stick_band):
        polish, seconds = _timed(
            lambda: nlp_polish(
                window.op,
                window.pv,
                best.stick_band,
                best.slip_jump,
                stem0=best.stem0,
                **_ORDERS,
            )
        )
        found.append(_of_fit("nlp, polish", polish.best, cost(polish.best), seconds))
    for intercept in (False, True):
        search = partial(grid_search, **_ORDERS, step=grid_step, intercept=intercept)
        grid, seconds = _timed(partial(search, window.op, window.pv))
        name = f"grid {grid_step:g}, " + ("intercept" if intercept else "as published")
        found.append(_of_fit(name, grid, cost(grid), seconds))
    return found


def _median_error(values: Sequence[float], truth: float, share: float = 0.5) -> float:
    errors = [abs(value - truth) / abs(truth) for value in values if math.isfinite(value)]
    return float(np.quantile(errors, share)) if errors else math.nan


def _coverage(bands: Sequence[Band | None], truth: float) -> float:
    known = [band for band in bands if band is not None and math.isfinite(band[0])]
    if not known:
        return math.nan
    return sum(low <= truth <= high for low, high in known) / len(known)


def summarise(
    example: str, truth: LoopModel, windows: Sequence[Sequence[Estimate]]
) -> list[Summary]:
    """Errors, coverage and ratios of every method over the windows of one example."""
    search = [window[0] for window in windows]
    seconds = float(np.median([one.seconds for one in search]))
    rows = []
    for method in dict.fromkeys(one.method for window in windows for one in window):
        chosen = [
            (one, base)
            for window, base in zip(windows, search, strict=True)
            for one in window
            if one.method == method
        ]
        found = [one for one, _ in chosen]
        bands, jumps = [one.stick_band for one in found], [one.slip_jump for one in found]
        half_sum = [0.5 * (s + j) for s, j in zip(bands, jumps, strict=True)]
        half_gap = [0.5 * (s - j) for s, j in zip(bands, jumps, strict=True)]
        rows.append(
            Summary(
                example=example,
                method=method,
                windows=len(found),
                static_friction=_median_error(half_sum, truth.valve.static_friction),
                dynamic_friction=_median_error(half_gap, truth.valve.dynamic_friction),
                stick_band=_median_error(bands, truth.valve.stick_band),
                stick_band_p90=_median_error(bands, truth.valve.stick_band, 0.9),
                slip_jump=_median_error(jumps, truth.valve.slip_jump),
                gain=_median_error([one.gain for one in found], truth.process.gain),
                slowest_pole=_median_error(
                    [one.slowest_pole for one in found], _slowest_pole(truth.process)
                ),
                coverage_stick_band=_coverage(
                    [one.stick_band_interval for one in found], truth.valve.stick_band
                ),
                coverage_slip_jump=_coverage(
                    [one.slip_jump_interval for one in found], truth.valve.slip_jump
                ),
                coverage_gain=_coverage([one.gain_interval for one in found], truth.process.gain),
                search_no_worse=float(
                    np.mean([base.cost <= one.cost * (1 + 1e-6) for one, base in chosen])
                ),
                time_ratio=float(np.median([one.seconds for one in found])) / seconds,
            )
        )
    return rows


def _published(example: Example) -> Summary:
    """The paper's own figures as a row; its time ratio is grid over optimisation."""
    said, truth = example.published, example.valve
    half = len(said.theta) // 2
    theta = ProcessModel(said.theta[:half], said.theta[half:], 1, 0.0, 1.0)
    valve = ValveModel.from_friction(said.static_friction, said.dynamic_friction)

    def error(value: float, true: float) -> float:
        return abs(value - true) / abs(true)

    return Summary(
        example=example.name,
        method=f"the paper ({said.static_friction:g}/{said.dynamic_friction:g})",
        windows=1,
        static_friction=error(said.static_friction, truth.static_friction),
        dynamic_friction=error(said.dynamic_friction, truth.dynamic_friction),
        stick_band=error(valve.stick_band, truth.stick_band),
        stick_band_p90=math.nan,
        slip_jump=error(valve.slip_jump, truth.slip_jump),
        gain=error(said.gain, example.process.gain),
        slowest_pole=error(_slowest_pole(theta), _slowest_pole(example.process)),
        coverage_stick_band=math.nan,
        coverage_slip_jump=math.nan,
        coverage_gain=math.nan,
        search_no_worse=math.nan,
        time_ratio=math.nan,
    )


_HEADER = (
    "example", "method", "windows", "fS", "fD", "S", "S p90", "J", "gain", "slowest pole",
    "cover S", "cover J", "cover gain", "search no worse", "time over search",
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="windows of each example")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first window")
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--grid-step", type=float, default=0.5)
    parser.add_argument("--starts", type=int, default=7, help="M of the paper's optimisation")
    parser.add_argument("--criteria", nargs="+", default=["auto", "arx"])
    parser.add_argument("--out", type=Path, help="folder for paper.md and paper.json")
    options = parser.parse_args(arguments)
    warm_up()
    rows: list[Summary] = []
    every: list[dict[str, Any]] = []
    for example in EXAMPLES:
        windows = []
        for seed in range(options.seed, options.seed + options.runs):
            window = example_window(example, seed, samples=options.samples)
            found = estimates(
                example,
                window,
                grid_step=options.grid_step,
                criteria=options.criteria,
                starts=options.starts,
            )
            windows.append(found)
            every += [{"example": example.name, "seed": seed, **asdict(one)} for one in found]
        rows += summarise(example.name, LoopModel(example.valve, example.process), windows)
        rows.append(_published(example))
    text = table(_HEADER, [list(asdict(row).values()) for row in rows])
    print(text)
    figures = {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "summary": [asdict(row) for row in rows],
        "windows": every,
    }
    keep(options.out, "paper", text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
