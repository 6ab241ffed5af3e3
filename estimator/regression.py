"""The linear part of the simulation criterion: gain, offset and initial state by least squares.

For a fixed valve, poles and dead time they are a small problem. The columns that all candidates
share (offset, drift, initial state) are projected out of PV once; what is left for a candidate is
summed over its slips by compiled code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask, complete, weighted
from estimator._response import Basis, Simulated, least_squares, orthonormal, simulated_tables
from estimator.structures import Structure, shared_columns

__all__ = ["MAX_LAG", "LinearFit", "Regression", "delayed"]

MAX_LAG = 20
"""Longest dead time that is tried, in samples."""


_TOLD = 0.05
"""A column of which the counted samples hold less than this share is unknown outside of them."""


@dataclass(frozen=True, slots=True)
class LinearFit:
    """The linear part at its best: ``gain`` of the response, ``columns`` of the structure."""

    gain: float
    columns: Array
    prediction: Array
    residual: Array


class Regression:
    """Least squares of PV on responses of candidates, over the good samples of a window.

    ``taps`` is the whitening filter of the noise, ``(1,)`` for plain simulation errors; it is
    applied to PV and to every column alike (generalised least squares). ``min_lag`` and ``max_lag``
    bound the dead time of a search; ``extra`` are further signals in PV, shape ``(k, n)``.
    """

    def __init__(
        self,
        y: Array,
        good: Mask,
        taps: Array | None = None,
        min_lag: int = 0,
        extra: Array | None = None,
    ) -> None:
        self.taps = np.ones(1) if taps is None else np.ascontiguousarray(taps)
        self.size = y.size
        usable = complete(good, self.taps.size - 1)
        self.min_lag = min_lag
        self.max_lag = min(MAX_LAG, y.size // 8)
        usable[: max(self.max_lag, self.taps.size - 1)] = False
        self.weight = usable.astype(np.float64)
        self.count = float(self.weight.sum())
        self.y = y
        self.good = good
        self.extra = np.empty((0, y.size)) if extra is None else extra
        self._target: Array = self.weighted(y[None])[0]
        level, slope = self._shared()
        self.basis = Basis(np.ascontiguousarray(self._target), level, slope, self.weight, self.taps)

    @property
    def total(self) -> float:
        """Sum of squares of PV around its mean, whitened, over the usable samples."""
        mean = self._target.sum() / self.count
        return float(((self._target - mean * self.weight) ** 2).sum())

    def weighted(self, rows: Array) -> Array:
        """Signals ``(k, n)`` through the noise filter, zero where a sample does not count."""
        through: Array = weighted(rows, self.taps, self.weight)
        return through

    def tables(self, structure: Structure) -> Simulated:
        """What the compiled sums need of one process."""
        made: Simulated = simulated_tables(
            self.basis, structure.slow, structure.fast, self.max_lag + 1
        )
        return made

    def solve(self, stem: Array, structure: Structure, dead_time: int) -> LinearFit:
        """The linear part for one stem, shape ``(n,)``, not whitened."""
        response = delayed(structure.response(stem), dead_time)
        # the response last: what the other columns explain is not the stem's
        raw = np.vstack([structure.columns(self.size), self.extra, response])
        design = self.weighted(raw)
        solution, residual = least_squares(design, self._target)
        # what has died away before the first sample that counts must not be drawn from it backwards
        told = np.einsum("ij,ij->i", design, design) > _TOLD**2 * np.einsum("ij,ij->i", raw, raw)
        known = np.where(told, solution, 0.0)
        prediction = np.where(self.weight > 0.0, solution @ raw, known @ raw)
        return LinearFit(float(solution[-1]), solution[:-1], prediction, residual)

    def _shared(self) -> tuple[Array, Array]:
        """Orthonormal columns that all candidates share, whitened and weighted, one a row.

        Without and with the straight line of an integrating process, which is the last row.
        """
        straight = shared_columns(self.size, integrating=True)
        rows: Array = orthonormal(
            self.weighted(np.vstack([np.delete(straight, 1, 0), self.extra, straight[1:2]]))
        )
        return np.ascontiguousarray(rows[:-1]), rows


def delayed(signal: Array, samples: int) -> Array:
    """``signal`` (shape ``(n,)``) later by ``samples``; the first value is held before it."""
    if samples == 0:
        return signal
    return np.concatenate([np.full(samples, signal[0]), signal[:-samples]])
