"""The linear part of a hypothesis under a fixed noise model: columns out first, responses then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.lanes import (
    Array,
    Index,
    combine,
    delayed_costs,
    dot,
    filter_rows,
    normal_equations,
    orthonormal,
    paired_costs,
    project_out,
    respond,
    solve_spd,
    whiten_lanes,
)
from estimator.rows import Rows

__all__ = ["Design", "LinearFit", "delay", "fit_linear"]


def delay(signal: Array, samples: int) -> Array:
    """``signal`` ``(n,)`` later by ``samples``; a response is zero before the window."""
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
        self.basis: Array = orthonormal(filter_rows(columns, self.taps, rows.weight))
        target = filter_rows(rows.y[None], self.taps, rows.weight)[0]
        self.target: Array = project_out(target, self.basis)
        self.rest = float(dot(self.target, self.target))

    def single(self, responses: Array, delays: Index, stride: int = 1) -> Array:
        """Sums of squares ``(D, L)`` with one gain at each of the ``delays``.

        The ``responses`` ``(n, L)`` are whitened in place.
        """
        rows = self.rows
        whiten_lanes(responses, self.taps)
        found: Array = delayed_costs(
            responses,
            rows.weight,
            self.target,
            self.basis,
            self.rest,
            rows.first,
            delays,
            stride,
            rows.sign,
        )
        return found

    def paired(
        self, stems: Array, processes: Array, shortest: int, count: int, stride: int = 1
    ) -> Array:
        """Sums of squares ``(count, L)`` for ``count`` dead times from ``shortest`` on."""
        rows = self.rows
        responses: Array = respond(stems, *processes)
        whiten_lanes(responses, self.taps)
        found: Array = paired_costs(
            responses,
            rows.weight,
            self.target,
            self.basis,
            self.rest,
            rows.first,
            shortest,
            count,
            stride,
            rows.sign,
        )
        return found


def fit_linear(
    rows: Rows, response: Array, dead_time: int, columns: Array, taps: Array
) -> LinearFit:
    """Generalised least squares of PV on a response ``(n,)`` at two dead times and columns.

    Gains of unlike sign, or of a sign that the loop cannot have, are not allowed: the better one of
    the two stays, or none.
    """
    raw = np.vstack([delay(response, dead_time), delay(response, dead_time + 1), columns])
    design = filter_rows(raw, taps, rows.weight)
    target = filter_rows(rows.y[None], taps, rows.weight)[0]
    gram, right = normal_equations(design, target)
    best: LinearFit | None = None
    for used in ((0, 1), (0,), (1,), ()):
        kept = np.array([*used, *range(2, len(raw))])
        solution: Array = solve_spd(gram[np.ix_(kept, kept)], right[kept])
        gains = np.zeros(2)
        gains[list(used)] = solution[: len(used)]
        if gains[0] * gains[1] < 0.0 or rows.sign * gains.sum() < 0.0:
            continue
        residual = rows.y - combine(solution, raw[kept])
        error = target - combine(solution, design[kept])
        fit = LinearFit(gains, solution[len(used) :], float(dot(error, error)), residual)
        if best is None or fit.squares < best.squares:
            best = fit
        if len(used) == 2 or (len(used) == 0):
            break
    assert best is not None
    return best
