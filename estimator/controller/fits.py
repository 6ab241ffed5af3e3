"""Least squares of OP's moves on what a controller may answer.

Many forms are tried on the same rows. Each is fitted in the triangle of all columns, which tells
the same as the rows do; the chosen one is fitted once more to the rows themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.algebra import dot, orthonormal, project_out
from estimator.arrays import Array

__all__ = ["TIE", "Fit", "fit_columns", "fit_instrumented", "left_by_pole", "triangle_of"]

TIE = 1e-6
"""Nats, or share of the moves, by which a form must be better: rounding decides nothing."""
_ALONG = 1e-10
"""Share of a column that others leave of it below which it tells nothing of its own."""
_ROUNDING = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Fit:
    """A form by its terms: coefficients, sum of squares left, and rows."""

    terms: tuple[str, ...]
    delay: int
    coefficients: Array
    squares: float
    rows: int

    def cost(self, floor: float) -> float:
        """BIC in nats."""
        return 0.5 * self.rows * math.log(self.squares / self.rows + floor) + 0.5 * len(
            self.terms
        ) * math.log(self.rows)

    @property
    def is_sensible(self) -> bool:
        """Whether all terms have one sign, and a filter's pole is between 0 and 1."""
        values = dict(zip(self.terms, self.coefficients, strict=False))
        pole = values.pop("f", 0.0)
        signs = {math.copysign(1.0, v) for v in values.values() if v != 0.0}
        return len(signs) == 1 and 0.0 <= pole < 0.98


def fit_columns(
    terms: tuple[str, ...], delay: int, columns: Mapping[str, Array], moves: Array, rows: int
) -> Fit:
    """Least squares of OP's moves on the columns of some terms."""
    design = np.stack([columns[t] for t in (*terms, "one")], axis=1)
    scale = np.sqrt(np.sum(design**2, axis=0) / rows) + 1e-300
    solution = np.linalg.lstsq(design / scale, moves, rcond=_ALONG)[0] / scale
    left = moves - design @ solution
    return Fit(terms, delay, solution, float(left @ left), rows)


@kernel
def left_by_pole(at_zero: Array, at_one: Array, poles: Array) -> Array:
    """Sums of squares ``(p,)`` that least squares leave at each of ``poles`` ``(p,)``.

    Rows ``(m, n)`` are linear in the pole: told at 0 and at 1, OP's moves first, then the columns.
    """
    left = np.empty(poles.size)
    for i in range(poles.size):
        rows = (1.0 - poles[i]) * at_zero + poles[i] * at_one
        rest = project_out(rows[0], orthonormal(rows[1:], _ALONG * _ALONG))
        left[i] = dot(rest, rest)
    return left


def triangle_of(columns: list[Array]) -> Array:
    """The triangle ``(m, m)`` of m columns: least squares among any of them are the same in it."""
    return np.asarray(np.linalg.qr(np.stack(columns, axis=1), mode="r"))


def fit_instrumented(
    terms: tuple[str, ...], used: list[int], tools: Array, columns: Array, moves: Array, rows: int
) -> Fit:
    """Least squares on what the instruments tell of the columns used."""
    design, rounding = columns[:, used], rows * _ROUNDING
    fitted = tools @ np.linalg.lstsq(tools, design, rcond=rounding)[0]
    solution = np.asarray(np.linalg.lstsq(fitted, moves, rcond=rounding)[0])
    left = moves - design @ solution
    return Fit(terms, 0, solution, float(left @ left), rows)
