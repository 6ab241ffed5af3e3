"""What each method says about one window of an example, and its cost in one currency.

The currency is equation (12), the paper's one-step-ahead cost, of ARX(3,3) with td = 0 and an
intercept, theta by least squares, behind He's valve with the method's S and J. Where the stem stood
before the first sample is a nuisance, and the methods treat it differently (the paper's: first or
mean OP; the search: free). So every method's valve gets the same rule: the best of the position the
method itself used, the first and the mean OP, and 41 positions across ``u_0 - fS`` to ``u_0 + fS``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.examples import Example, ExampleWindow
from estimator import grid_search, identify, nlp_paper, nlp_polish
from estimator.published.paper_fit import ArxStructure, ArxWindow, PaperFit
from estimator.published.same_moves import best_with_same_moves
from estimator.valves import HeValve
from loop_model import ProcessModel

__all__ = ["METHODS", "Band", "Estimate", "estimates", "free_start_cost"]

Band = tuple[float, float]

METHODS = ("search", "truth", "oracle", "nlp", "polish", "grid")
"""``search`` is `identify`; ``truth`` gets the true valve, ``oracle`` the moments of its moves."""

_ORDERS: dict[str, Any] = {"na": 3, "nb": 3, "dead_time": 1}
_POSITIONS = 41


@dataclass(frozen=True, slots=True)
class Estimate:
    """What one method says about one window; ``cost`` is in the currency of this module."""

    method: str
    stick_band: float
    slip_jump: float
    gain: float
    poles: tuple[complex, ...]
    cost: float
    seconds: float
    stem0: float
    verdict: str = ""
    stick_band_interval: Band | None = None
    slip_jump_interval: Band | None = None
    gain_interval: Band | None = None


def poles_of(process: ProcessModel) -> tuple[complex, ...]:
    """Roots of ``z^na A``, slowest first."""
    roots = np.roots([1.0, *process.a])
    return tuple(complex(r) for r in roots[np.argsort(-np.abs(roots), kind="stable")])


def free_start_cost(
    currency: ArxWindow, stick_band: float, slip_jump: float, positions: Sequence[float] = ()
) -> float:
    """Lowest cost (12) of a valve over first positions: the given ones and those of the rule."""
    valve, op = HeValve(stick_band, slip_jump), currency.op
    reach = valve.static_friction * np.linspace(-1.0, 1.0, _POSITIONS)
    tried = [*positions, float(op[0]), float(op.mean()), *(op[0] + reach).tolist()]
    return min(currency.solve(valve.simulate(op, start))[1] for start in tried)


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """The answer, and the seconds of one core that it took, whatever else the machine does."""
    with threadpool_limits(limits=1):
        begun = time.process_time()
        answer = call()
        return answer, time.process_time() - begun


def _of_fit(method: str, fit: PaperFit, currency: ArxWindow, seconds: float) -> Estimate:
    band, jump = fit.valve.stick_band, fit.valve.slip_jump
    return Estimate(
        method=method,
        stick_band=band,
        slip_jump=jump,
        gain=fit.process.gain,
        poles=poles_of(fit.process),
        cost=free_start_cost(currency, band, jump, [fit.stem0]),
        seconds=seconds,
        stem0=fit.stem0,
    )


def _of_search(
    window: ExampleWindow, currency: ArxWindow, criterion: str, confidence: float
) -> Estimate:
    result, seconds = _timed(
        lambda: identify(window.op, window.pv, criterion=criterion, confidence=confidence)
    )
    band, jump, gain = result.stick_band, result.slip_jump, result.process.gain_interval
    cost, stem0 = math.nan, math.nan
    if result.model is not None:
        stem0 = float(result.stem[0])
        own = currency.solve(result.stem)[1]
        cost = min(own, free_start_cost(currency, band.value, jump.value))
    return Estimate(
        method=f"search, {criterion}",
        stick_band=band.value,
        slip_jump=jump.value,
        gain=gain.value,
        poles=() if result.model is None else poles_of(result.model.process),
        cost=cost,
        seconds=seconds,
        stem0=stem0,
        verdict=result.verdict.value,
        stick_band_interval=(band.low, band.high),
        slip_jump_interval=(jump.low, jump.high),
        gain_interval=(gain.low, gain.high),
    )


def estimates(
    example: Example,
    window: ExampleWindow,
    *,
    methods: Sequence[str] = METHODS,
    criteria: Sequence[str] = ("auto", "arx"),
    grid_step: float = 0.1,
    starts: int = 7,
    confidence: float = 0.9,
) -> list[Estimate]:
    """The chosen methods on one window; the first is the search with the first of ``criteria``."""
    currency = ArxWindow.of(window.op, window.pv, ArxStructure(**_ORDERS))
    found = [_of_search(window, currency, criterion, confidence) for criterion in criteria]
    op, pv = window.op, window.pv
    truth = HeValve(example.valve.stick_band, example.valve.slip_jump)
    if "truth" in methods:
        fit = currency.fit(truth, float(window.stem[0]))
        found.append(_of_fit("the true valve", fit, currency, math.nan))
    if "oracle" in methods:
        for intercept in (True, False):
            told = ArxWindow.of(window.op, window.pv, ArxStructure(**_ORDERS, intercept=intercept))
            known = best_with_same_moves(told, told.fit(truth, float(window.stem[0])))
            name = "oracle: the true moves" + ("" if intercept else " and the zero of PV")
            found.append(_of_fit(name, known, currency, math.nan))
    if "nlp" in methods:
        nlp, seconds = _timed(partial(nlp_paper, op, pv, **_ORDERS, starts=starts))
        found.append(_of_fit(f"nlp, paper, M={starts} twice", nlp.best, currency, seconds))
    best = found[0]
    if "polish" in methods and math.isfinite(best.stick_band):
        pair = (best.stick_band, best.slip_jump)
        call = partial(nlp_polish, op, pv, *pair, stem0=best.stem0, **_ORDERS)
        polish, seconds = _timed(call)
        found.append(_of_fit("nlp, polish of the search", polish.best, currency, seconds))
    if "grid" in methods:
        grid, seconds = _timed(partial(grid_search, op, pv, **_ORDERS, step=grid_step))
        found.append(_of_fit(f"grid {grid_step:g}", grid, currency, seconds))
    return found
