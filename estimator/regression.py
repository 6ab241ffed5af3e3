"""The linear part of the simulation criterion: gain, offset and initial state by least squares.

For a fixed valve, poles and dead time they are a small problem. The columns that all candidates
share (offset, drift, initial state) are projected out of PV once; what is left for a candidate is
summed over its slips by compiled code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask, complete, fir
from estimator._response import Basis, Simulated, orthonormal, simulated_tables
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
    bound the dead time of a search; ``extra`` are further columns for PV, shape ``(n, k)``.
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
        self.extra = np.empty((y.size, 0)) if extra is None else extra
        self._target = self.whiten(y[:, None])[:, 0] * self.weight
        level, slope = self._shared()
        self.basis = Basis(np.ascontiguousarray(self._target), level, slope, self.weight, self.taps)

    @property
    def total(self) -> float:
        """Sum of squares of PV around its mean, whitened, over the usable samples."""
        mean = self._target.sum() / self.count
        return float(((self._target - mean * self.weight) ** 2).sum())

    def whiten(self, signal: Array) -> Array:
        """Apply the noise filter along the first axis of ``signal``, shape ``(n, m)``."""
        if self.taps.size == 1:
            return signal
        return fir(np.ascontiguousarray(signal), self.taps)

    def tables(self, structure: Structure) -> Simulated:
        """What the compiled sums need of one process."""
        made: Simulated = simulated_tables(
            self.basis, structure.slow, structure.fast, self.max_lag + 1
        )
        return made

    def solve(self, stem: Array, structure: Structure, dead_time: int) -> LinearFit:
        """The linear part for one stem, shape ``(n,)``, not whitened."""
        response = delayed(structure.response(np.ascontiguousarray(stem[:, None])), dead_time)
        raw = np.hstack([response, structure.columns(self.size), self.extra])
        design = self.whiten(raw) * self.weight[:, None]
        size = np.sqrt(np.einsum("ij,ij->j", design, design))
        size[size == 0.0] = 1.0
        basis, root = np.linalg.qr(design / size)
        solution, *_ = np.linalg.lstsq(root, basis.T @ self._target, rcond=1e-10)
        solution = solution / size
        # what has died away before the first sample that counts must not be drawn from it backwards
        told = size > _TOLD * np.sqrt(np.einsum("ij,ij->j", raw, raw))
        known = np.where(told, solution, 0.0)
        prediction = np.where(self.weight > 0.0, raw @ solution, raw @ known)
        residual = np.where(self.weight > 0.0, self._target - design @ solution, 0.0)
        return LinearFit(float(solution[0]), solution[1:], prediction, residual)

    def _shared(self) -> tuple[Array, Array]:
        """Orthonormal columns that all candidates share, whitened and weighted, one a row.

        Without and with the straight line of an integrating process, which is the last row.
        """
        straight = shared_columns(self.size, integrating=True)
        columns = self.whiten(np.hstack([np.delete(straight, 1, 1), self.extra, straight[:, 1:2]]))
        rows: Array = orthonormal(np.ascontiguousarray((columns * self.weight[:, None]).T))
        return np.ascontiguousarray(rows[:-1]), rows


def delayed(signal: Array, samples: int) -> Array:
    """``signal`` (shape ``(n, m)``) later by ``samples``; the first value is held before it."""
    if samples == 0:
        return signal
    return np.vstack([np.repeat(signal[:1], samples, axis=0), signal[:-samples]])
