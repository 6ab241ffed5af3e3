"""The methods that are compared: ours, the paper's, and published ones, each on one loop.

A method gives a `Finding`: a verdict, a score, S and J, whichever of them it has. Methods that need
every sample get gaps filled by straight lines, as their users do.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.families.loop import RecordedLoop
from benchmarks.published import (
    Finding,
    count_shapes,
    find_stuck_intervals,
    fit_curve,
    judge_bicoherence,
)
from benchmarks.published.finding import Call
from estimator import EstimatorError, Verdict, grid_search, identify, nlp_paper
from estimator.monitoring.indices import apparent_stiction, cross_correlation

__all__ = ["OURS", "RIVALS", "SIZERS", "SLOW", "Timed", "run"]

Array = NDArray[np.float64]
Method = Callable[[RecordedLoop], Finding]

OURS = "ours"

GRID_STEP = 0.04
"""Step of the paper's grid and of its starts, share of OP's span: 0.5 in the paper's examples."""
ORDERS = 2
"""Orders na and nb of the paper's process model, as in its industrial cases."""
LONGEST_DEAD_TIME = 12
"""Samples of dead time tried for the paper's methods, which take it as known."""


@dataclass(frozen=True, slots=True)
class Timed:
    """A finding and the seconds of one core that it took."""

    finding: Finding
    seconds: float


def _filled(signal: Array) -> Array:
    good = np.flatnonzero(np.isfinite(signal))
    return np.asarray(np.interp(np.arange(signal.size), good, signal[good]))


def _signals(loop: RecordedLoop) -> tuple[Array, Array]:
    return _filled(loop.op), _filled(loop.pv)


def _ours(loop: RecordedLoop) -> Finding:
    result = identify(loop.op, loop.pv, sp=loop.sp, period=loop.period)
    band, jump = result.stick_band.value, result.slip_jump.value
    call: Call = "stiction" if result.verdict is Verdict.STICTION else "no_stiction"
    if result.verdict is Verdict.NOT_ASSESSABLE or getattr(result, "uncertain", False):
        call = "undecided"
    return Finding(call, float(result.score), band, jump)


def _horch(loop: RecordedLoop) -> Finding:
    found = cross_correlation(*_signals(loop))
    return Finding(found.finding.value, found.height_asymmetry)


def _ellipse(loop: RecordedLoop) -> Finding:
    op, pv = _signals(loop)
    width = apparent_stiction(op, pv).apparent_stiction
    return Finding("", width / float(op.std()), stick_band=width)


def _bicoherence(loop: RecordedLoop) -> Finding:
    op, pv = _signals(loop)
    return judge_bicoherence(op, pv, loop.sp)


def _dead_time(op: Array, pv: Array) -> int:
    """Dead time with the least one-step error of the linear ARX(2,2), a healthy valve assumed."""
    first = LONGEST_DEAD_TIME + ORDERS
    rows = np.arange(first, op.size)
    best, least = 1, np.inf
    for dead in range(1, LONGEST_DEAD_TIME + 1):
        past = [pv[rows - i] for i in range(1, ORDERS + 1)]
        past += [op[rows - dead - i] for i in range(ORDERS)]
        design = np.column_stack([*past, np.ones(rows.size)])
        theta = np.linalg.lstsq(design, pv[rows], rcond=None)[0]
        cost = float(((pv[rows] - design @ theta) ** 2).sum())
        if cost < least:
            best, least = dead, cost
    return best


def _grid(loop: RecordedLoop) -> Finding:
    op, pv = _signals(loop)
    step = GRID_STEP * float(np.ptp(op))
    fit = grid_search(op, pv, na=ORDERS, nb=ORDERS, dead_time=_dead_time(op, pv), step=step)
    band, jump = fit.valve.stick_band, fit.valve.slip_jump
    return Finding("", band / float(np.ptp(op)), band, jump)


def _nlp(loop: RecordedLoop) -> Finding:
    op, pv = _signals(loop)
    step = GRID_STEP * float(np.ptp(op))
    fit = nlp_paper(op, pv, na=ORDERS, nb=ORDERS, dead_time=_dead_time(op, pv), step=step).best
    band, jump = fit.valve.stick_band, fit.valve.slip_jump
    return Finding("", band / float(np.ptp(op)), band, jump)


RIVALS: dict[str, Method] = {
    OURS: _ours,
    "cross-correlation (Horch)": _horch,
    "curve fitting (He)": lambda loop: fit_curve(
        *_signals(loop), integrating=loop.kind == "integrating"
    ),
    "bicoherence, ellipse (Choudhury)": _bicoherence,
    "shapes (Yamashita)": lambda loop: count_shapes(*_signals(loop)),
    "stuck intervals (Kano)": lambda loop: find_stuck_intervals(*_signals(loop)),
    "ellipse alone (Choudhury)": _ellipse,
    "grid (the paper)": _grid,
    "optimisation (the paper)": _nlp,
}
"""Methods by name."""

SIZERS = ("ellipse alone (Choudhury)", "grid (the paper)", "optimisation (the paper)")
"""Methods that size a valve and give no verdict."""

SLOW = ("optimisation (the paper)",)
"""Methods that take seconds to minutes for one loop, run on a few loops only."""


def run(name: str, loop: RecordedLoop) -> Timed:
    """One method on one loop; a window that it refuses is undecided."""
    with threadpool_limits(limits=1):
        begun = time.process_time()
        try:
            finding = RIVALS[name](loop)
        except EstimatorError:
            finding = Finding("undecided", math.nan)
        return Timed(finding, time.process_time() - begun)
