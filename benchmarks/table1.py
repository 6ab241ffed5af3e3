"""Table 1 of the paper, and our rows for the same loops.

The published rows are those of Bacci di Capaci et al. (2018), Table 1 (K & K: Karra and Karim,
2009; Lee et al., 2008; Jelali, 2008). Our own are the search with each criterion, and the paper's
two methods as we built them, with the paper's settings.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import table
from estimator import grid_search, identify, nlp_paper
from estimator.published.paper_fit import PaperFit

__all__ = ["CASES", "Case", "Row", "our_rows", "table_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Row:
    """One estimate: ``orders`` are (na, nb, nc) as published, frictions in units of OP."""

    method: str
    valve: str
    orders: str
    static_friction: float
    dynamic_friction: float
    seconds: float | None

    @property
    def stick_band(self) -> float:
        """``S = fS + fD``."""
        return self.static_friction + self.dynamic_friction

    @property
    def slip_jump(self) -> float:
        """``J = fS - fD``."""
        return self.static_friction - self.dynamic_friction


@dataclass(frozen=True, slots=True)
class Case:
    """A loop of the table: its place in the data base, what part of it, orders, published rows."""

    name: str
    isdb: str
    samples: int | None
    orders: tuple[int, int]
    published: tuple[Row, ...]


CASES = (
    Case(
        "CHEM 10",
        "chemicals.loop10",
        None,
        (2, 2),
        (
            Row("paper, proposed", "smoothed, tau 250", "2,2", 0.16, 0.06, 7.0),
            Row("paper, proposed", "smoothed, tau 1e4", "2,2", 0.85, 0.13, 7.0),
            Row("paper, grid 0.1", "smoothed", "2,2", 1.70, 0.00, 141.0),
            Row("K & K", "Kano", "2,2,2", 0.95, 0.90, None),
            Row("Lee et al.", "He", "2,1", 1.75, 0.04, None),
        ),
    ),
    Case(
        "CHEM 25",
        "chemicals.loop25",
        None,
        (2, 2),
        (
            Row("paper, proposed", "smoothed, tau 250", "2,1", 1.45, 0.25, 3.7),
            Row("paper, proposed", "smoothed, tau 250", "2,2", 0.56, 0.41, 4.1),
            Row("paper, proposed", "smoothed, tau 250", "3,2", 0.76, 0.61, 5.6),
            Row("paper, grid 0.1", "smoothed", "2,1", 1.00, 0.50, 48.0),
            Row("K & K", "Kano", "2,2,2", 1.15, 0.75, None),
            Row("Jelali (i)", "Kano", "3,2,2", 1.20, 0.60, None),
            Row("Jelali (ii)", "Kano", "2,2,1", 1.24, 0.64, None),
            Row("Lee et al.", "He", "2,1", 3.84, 0.00, None),
        ),
    ),
    Case(
        "POW 4",
        "power.loop4",
        1000,
        (2, 2),
        (
            Row("paper, proposed", "smoothed, tau 250", "2,1", 1.93, 0.08, 15.1),
            Row("paper, proposed", "smoothed, tau 250", "2,2", 0.35, 0.28, 19.6),
            Row("paper, proposed", "smoothed, tau 250", "3,2", 0.53, 0.45, 16.7),
            Row("paper, grid 0.1", "smoothed", "2,1", 1.40, 0.10, 527.0),
            Row("K & K", "Kano", "", 2.40, 1.20, None),
            Row("Jelali", "Kano", "", 3.49, 1.00, None),
            Row("Lee et al.", "He", "2,1", 0.49, 0.09, None),
        ),
    ),
)
"""The loops of Table 1; for POW 4 the paper takes the first 1,000 samples."""


def our_rows(
    case: Case, op: Array, pv: Array, *, starts: int = 7, grid_step: float = 0.1
) -> list[Row]:
    """Our rows for a loop of the table; ``starts`` 0 leaves the paper's methods out.

    A search whose verdict is not stiction still has its best valve, and its method says so.
    """
    op, pv = op[: case.samples], pv[: case.samples]
    rows = []
    for criterion in ("auto", "oe", "arx"):
        result = identify(op, pv, criterion=criterion)
        verdict = "" if result.verdict.value == "stiction" else f" ({result.verdict.value})"
        rows.append(
            Row(
                f"ours, search {criterion}{verdict}",
                "He",
                result.process.structure,
                result.static_friction.value,
                result.dynamic_friction.value,
                result.seconds,
            )
        )
    if starts == 0:
        return rows
    na, nb = case.orders
    calls: list[tuple[str, float, Callable[[], PaperFit]]] = [
        (
            f"ours, nlp M={starts} twice",
            tau,
            partial(_nlp, op, pv, na=na, nb=nb, tau=tau, starts=starts),
        )
        for tau in (250.0, 1e4)
    ]
    grid = partial(grid_search, op, pv, na=na, nb=nb, step=grid_step)
    calls.append((f"ours, grid {grid_step:g}", 1e4, grid))
    for method, tau, call in calls:
        begun = time.perf_counter()
        fit = call()
        seconds = time.perf_counter() - begun
        valve = f"smoothed, tau {tau:g}".replace("10000", "1e4")
        frictions = (fit.static_friction, fit.dynamic_friction)
        rows.append(Row(method, valve, f"{na},{nb}", *frictions, seconds))
    return rows


def _nlp(op: Array, pv: Array, **options: Any) -> PaperFit:
    return nlp_paper(op, pv, **options).best


def table_of(case: Case, rows: Sequence[Row]) -> str:
    """Published rows and ours, as Markdown."""
    header = ("method", "valve", "orders", "fS", "fD", "S", "J", "seconds")
    lines = []
    for row in (*case.published, *rows):
        seconds = math.nan if row.seconds is None else row.seconds
        pair = (row.static_friction, row.dynamic_friction)
        lines.append(
            (row.method, row.valve, row.orders, *pair, row.stick_band, row.slip_jump, seconds)
        )
    return f"### {case.name}\n\n{table(header, lines)}"
