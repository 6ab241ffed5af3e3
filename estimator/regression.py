"""The linear part, eliminated: cost of many stems at once for a process structure and dead times.

For a fixed valve, poles and dead time the best gain, offset and initial state are a small least
squares problem. The columns that all candidates share (offset, initial state) are projected out of
PV once; what is left for a candidate are inner products of its response with a few rows, and those
of all candidates and all dead times together are one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask, fir
from estimator.structures import Structure

__all__ = ["MAX_LAG", "LinearFit", "Regression", "delayed"]

MAX_LAG = 20
"""Longest dead time that is tried, in samples."""

_FLAT = 1e-6


@dataclass(frozen=True, slots=True)
class LinearFit:
    """The linear part at its best: ``gain`` of the response, ``columns`` of the structure.

    ``information`` is the response's energy that no column shares (the gain's variance is the
    noise's divided by it).
    """

    gain: float
    information: float
    columns: Array
    prediction: Array
    residual: Array


class Regression:
    """Least squares of PV on responses of candidates, over the good samples of a window.

    ``taps`` is the whitening filter of the noise, ``(1,)`` for plain simulation errors; it is
    applied to PV and to every column alike (generalised least squares). ``min_lag`` and ``max_lag``
    bound the dead time of a search.
    """

    def __init__(self, y: Array, good: Mask, taps: Array | None = None, min_lag: int = 0) -> None:
        self.taps = np.ones(1) if taps is None else np.ascontiguousarray(taps)
        self.size = y.size
        usable = good.copy()
        for i in range(1, self.taps.size):
            usable[i:] &= good[:-i]
        self.min_lag = min_lag
        self.max_lag = min(MAX_LAG, y.size // 8)
        usable[: max(self.max_lag, self.taps.size - 1)] = False
        self.weight = usable.astype(np.float64)
        self.count = float(self.weight.sum())
        self.y = y
        self.good = good
        self._target = self.whiten(y[:, None])[:, 0] * self.weight
        self._rows: dict[Structure, tuple[Array, float]] = {}
        self._stacks: dict[tuple[Structure, tuple[int, ...]], Array] = {}

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

    def costs(self, stem: Array, structure: Structure, lags: tuple[int, ...]) -> Array:
        """Residual sums of squares, shape ``(len(lags), m)``, for whitened stems ``(n, m)``."""
        response = structure.response(stem)
        return self._eliminated(response, structure, lags)[0]

    def costs_and_gains(
        self, stem: Array, structure: Structure, lags: tuple[int, ...]
    ) -> tuple[Array, Array]:
        """Residual sums of squares and gains, shape ``(len(lags), m)`` each."""
        return self._eliminated(structure.response(stem), structure, lags)

    def solve(self, stem: Array, structure: Structure, dead_time: int) -> LinearFit:
        """The linear part for one stem, shape ``(n,)``, not whitened."""
        response = delayed(structure.response(np.ascontiguousarray(stem[:, None])), dead_time)
        raw = np.hstack([response, structure.columns(self.size)])
        design = self.whiten(raw) * self.weight[:, None]
        size = np.sqrt(np.square(design).sum(axis=0))
        size[size == 0.0] = 1.0
        solution, *_ = np.linalg.lstsq(design / size, self._target, rcond=1e-10)
        solution = solution / size
        prediction = raw @ solution
        residual = np.where(self.weight > 0.0, self._target - design @ solution, 0.0)
        others, _ = np.linalg.qr(design[:, 1:])
        own = design[:, 0] - others @ (others.T @ design[:, 0])
        return LinearFit(float(solution[0]), float(own @ own), solution[1:], prediction, residual)

    def rows(self, structure: Structure) -> tuple[Array, float]:
        """PV without its shared columns, above the orthonormal columns; and PV's energy left."""
        found = self._rows.get(structure)
        if found is None:
            columns = self.whiten(structure.columns(self.size)) * self.weight[:, None]
            q, _ = np.linalg.qr(columns)
            rest = self._target - q @ (q.T @ self._target)
            found = np.ascontiguousarray(np.vstack([rest, q.T])), float(rest @ rest)
            self._rows[structure] = found
        return found

    def _eliminated(
        self, response: Array, structure: Structure, lags: tuple[int, ...]
    ) -> tuple[Array, Array]:
        rows, total = self.rows(structure)
        products = self._stack(structure, lags) @ response
        products = products.reshape(len(lags), rows.shape[0], -1)
        squares = self._energy(response, lags)
        left = squares - np.square(products[:, 1:]).sum(axis=1)
        flat = left <= _FLAT * squares + 1e-12
        gain = np.where(flat, 0.0, products[:, 0] / np.where(flat, 1.0, left))
        cost = total - gain * products[:, 0]
        return np.maximum(cost, 1e-12 * total + 1e-300), gain

    def _stack(self, structure: Structure, lags: tuple[int, ...]) -> Array:
        key = structure, lags
        if key not in self._stacks:
            rows, _ = self.rows(structure)
            self._stacks[key] = np.vstack([_advanced(rows, d) for d in lags])
        return self._stacks[key]

    def _energy(self, response: Array, lags: tuple[int, ...]) -> Array:
        weights = np.vstack([_advanced(self.weight[None], d) for d in lags])
        return weights @ np.square(response)


def delayed(signal: Array, samples: int) -> Array:
    """``signal`` (shape ``(n, m)``) later by ``samples``; the first value is held before it."""
    if samples == 0:
        return signal
    return np.vstack([np.repeat(signal[:1], samples, axis=0), signal[:-samples]])


def _advanced(rows: Array, samples: int) -> Array:
    if samples == 0:
        return rows
    out = np.zeros_like(rows)
    out[:, :-samples] = rows[:, samples:]
    return out
