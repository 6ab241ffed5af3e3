"""The linear part of a hypothesis under a fixed noise model: columns out first, responses then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.algebra import (
    combine,
    dot,
    filter_rows,
    normal_equations,
    orthonormal,
    project_out,
    solve_spd,
)
from estimator.arrays import Array
from estimator.lane_costs import Judged, costs_of_processes, costs_of_stems
from estimator.rows import Rows, judged_rows

__all__ = ["Design", "LinearFit", "delay", "fit_linear", "fit_rows", "left_of_pv"]


def delay(signal: Array, samples: int) -> Array:
    """Delay ``signal`` ``(n,)`` by ``samples``; a response is zero before the window."""
    if samples == 0:
        return signal
    out = np.zeros(signal.size)
    out[samples:] = signal[: signal.size - samples]
    return out


@dataclass(frozen=True, slots=True)
class LinearFit:
    """The linear part of one hypothesis at its best.

    Attributes:
        gains: of the responses at the dead time and one sample later, ``(2,)``.
        columns: coefficients of the other columns, ``(m,)``.
        squares: sum of squares of the innovations.
        residual: what the model leaves of PV, not whitened, ``(n,)``.
    """

    gains: Array
    columns: Array
    squares: float
    residual: Array


class Design:
    """PV and the columns beside the response, whitened by ``taps`` and taken out of each other.

    Args:
        rows: the window's rows.
        taps: the noise model, ``(p,)``.
        columns: what PV may hold beside the response, ``(m, n)``, not whitened.
    """

    def __init__(self, rows: Rows, taps: Array, columns: Array) -> None:
        self.rows = rows
        self.taps = np.ascontiguousarray(taps)
        found: tuple[Array, float] = _whitened(columns, rows.y, self.taps, rows.weight)
        self.signals, self.rest = found
        self.judged = self.judged_every(1)

    def judged_every(self, stride: int) -> Judged:
        """What candidates are judged by where every so many rows count."""
        rows = self.rows
        judged = rows.judged if stride == 1 else judged_rows(rows.weight, rows.first, stride)
        return self.taps, judged, stride, self.signals, self.rest, rows.sign

    def paired(
        self, stems: Array, processes: Array, shortest: int, count: int, stride: int = 1
    ) -> Array:
        """Sums of squares ``(count, L)`` for ``count`` dead times from ``shortest`` on.

        Of stems ``(n, L)``, each through a process of its own, ``(4, L)``.
        """
        judged = self.judged if stride == 1 else self.judged_every(stride)
        processes = np.ascontiguousarray(processes)
        found: Array = costs_of_stems(stems, processes, judged, shortest, count)
        return found

    def through(self, stem: Array, processes: Array, shortest: int, count: int) -> Array:
        """The same for one stem ``(n,)`` through all of the processes ``(4, L)``."""
        processes = np.ascontiguousarray(processes)
        found: Array = costs_of_processes(stem, processes, self.judged, shortest, count)
        return found


@kernel
def _whitened(columns: Array, y: Array, taps: Array, weight: Array) -> tuple[Array, float]:
    """What the whitened columns leave of whitened PV, and a basis of them, ``(n, 1 + m)``.

    And the sum of squares of the first.
    """
    basis = orthonormal(filter_rows(columns, taps, weight))
    signal = np.empty((1, y.size))
    signal[0] = y
    target = project_out(filter_rows(signal, taps, weight)[0], basis)
    found = np.empty((y.size, 1 + basis.shape[0]))
    for k in range(y.size):
        found[k, 0] = target[k]
        for c in range(basis.shape[0]):
            found[k, 1 + c] = basis[c, k]
    return found, dot(target, target)


def left_of_pv(
    rows: Rows, response: Array, dead_time: int, columns: Array, taps: Array
) -> tuple[Array, Array]:
    """An orthonormal basis of process and columns, ``(k, n)``, and what it leaves of PV, ``(n,)``.

    Both whitened.

    Args:
        rows: the window's rows.
        response: of the process without its dead time, ``(n,)``; it takes both samples of it.
        dead_time: in samples.
        columns: what else is known, ``(m, n)``.
        taps: the noise model, ``(p,)``.
    """
    late = [delay(response, dead_time + more)[None] for more in (0, 1)]
    basis = orthonormal(filter_rows(np.vstack([columns, *late]), taps, rows.weight))
    return basis, project_out(filter_rows(rows.y[None], taps, rows.weight)[0], basis)


def fit_linear(
    rows: Rows, response: Array, dead_time: int, columns: Array, taps: Array
) -> LinearFit:
    """Generalised least squares of PV on a response ``(n,)`` at two dead times and columns.

    Gains of unlike sign, or of a sign that the loop cannot have, are not allowed: the better one of
    the two stays, or none.
    """
    solution, squares, residual = fit_rows(
        rows.y, response, dead_time, columns, taps, rows.weight, rows.sign
    )
    return LinearFit(solution[:2], solution[2:], squares, residual)


@kernel
def fit_rows(
    y: Array,
    response: Array,
    dead_time: int,
    columns: Array,
    taps: Array,
    weight: Array,
    sign: float,
) -> tuple[Array, float, Array]:
    """Solution ``(2 + m,)``, sum of squares and residual ``(n,)`` of `fit_linear`."""
    m, n = 2 + columns.shape[0], y.size
    raw = np.zeros((m + 1, n))
    for k in range(n):
        if k >= dead_time:
            raw[0, k] = response[k - dead_time]
        if k > dead_time:
            raw[1, k] = response[k - dead_time - 1]
        raw[m, k] = y[k]
    raw[2:m] = columns
    every = filter_rows(raw, taps, weight)
    design, target = every[:m], every[m]
    gram, right = normal_equations(design, target)
    best = np.zeros(m)
    least = np.inf
    residual = y
    # both responses, the earlier one, the later one, none
    for first, last in ((0, 2), (0, 1), (1, 2), (2, 2)):
        own = last - first
        kept = np.empty(own + m - 2, dtype=np.int64)
        for i in range(kept.size):
            kept[i] = first + i if i < own else 2 + i - own
        small, short = np.empty((kept.size, kept.size)), np.empty(kept.size)
        for i in range(kept.size):
            short[i] = right[kept[i]]
            for j in range(kept.size):
                small[i, j] = gram[kept[i], kept[j]]
        part = solve_spd(small, short)
        found = np.zeros(m)
        for i in range(kept.size):
            found[kept[i]] = part[i]
        if found[0] * found[1] < 0.0 or sign * (found[0] + found[1]) < 0.0:
            continue
        error = target - combine(found, design)
        squares = dot(error, error)
        if squares < least:
            least, best = squares, found
            residual = y - combine(found, raw[:m])
        if own == 2:
            break
    return best, least, residual
