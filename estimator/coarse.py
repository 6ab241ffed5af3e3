"""The coarse pass: every valve of a grid with every process of a list, on a thinned window.

Only every ``stride``-th sample of the responses enters least squares (the valves and the lags run
through all of them), and costs are shares of PV's energy: good for ranking, no likelihoods.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from estimator._kernels import Array, Mask
from estimator.structures import Structure

__all__ = ["LAGS", "coarse_costs", "coarse_valves"]

LAGS = (0, 1, 2, 3, 5, 8, 12, 18)
"""Dead times of the coarse pass, in samples."""

_FINE = (
    (0.01, 0.02, 0.035, 0.05, 0.065, 0.08, *np.arange(0.1, 1.0, 0.0125)),
    (0.0, 0.2, 0.4, 0.65, 1.0),
    (-0.75, 0.75),
)
_STARTED = (
    (
        *(0.01, 0.02, 0.03, 0.045, 0.065, 0.09, 0.12, 0.16, 0.2, 0.25, 0.3),
        *(0.36, 0.42, 0.48, 0.54, 0.6, 0.66, 0.72, 0.78, 0.84, 0.9, 0.96),
    ),
    (0.0, 0.15, 0.35, 0.6, 1.0),
    (-0.95, -0.8, -0.65, -0.5, 0.5, 0.65, 0.8, 0.95),
)
_ROWS = 400
_FLAT = 1e-6


@cache
def coarse_valves() -> tuple[Array, Array, Array]:
    """Stick band, ratio J/S and start of the grid, shape ``(m,)`` each.

    Two grids: a cycling valve needs the stick band finely (a slip one sample off costs much), one
    that moves a few times needs the start.
    """
    parts = []
    for axes in (_FINE, _STARTED):
        grids = np.meshgrid(*(np.array(axis) for axis in axes), indexing="ij")
        parts.append(np.stack([grid.ravel() for grid in grids]))
    band, ratio, start = np.ascontiguousarray(np.hstack(parts))
    return band, ratio, start


def coarse_costs(
    y: Array, good: Mask, response: Array, structure: Structure, lags: tuple[int, ...]
) -> Array:
    """Share of PV's energy that is left, shape ``(len(lags), m)``.

    ``response`` is that of ``structure`` to ``m`` stems, shape ``(n, m)``; ``y`` and ``good`` have
    shape ``(n,)``.
    """
    n = y.size
    stride = max(1, n // _ROWS)
    rows = np.arange(max(lags), n - max(lags), stride)
    index = rows[None] + np.array(lags)[:, None]
    weight = good[index].astype(np.float64)
    columns = structure.columns(n)[index] * weight[:, :, None]
    gram = np.einsum("dmi,dmj->dij", columns, columns)
    size = np.sqrt(np.einsum("dii->di", gram)) + 1e-12
    columns /= size[:, None, :]
    gram /= size[:, :, None] * size[:, None, :]
    gram += 1e-9 * np.eye(gram.shape[1])
    root = np.linalg.cholesky(gram)
    basis = np.linalg.solve(root, columns.transpose(0, 2, 1))
    target = y[index] * weight
    target = target - np.einsum("dkm,dk->dm", basis, np.einsum("dkm,dm->dk", basis, target))
    stack = np.concatenate([target[:, None], basis], axis=1)
    thin = np.ascontiguousarray(response[rows])
    products = (stack.reshape(-1, rows.size) @ thin).reshape(len(lags), stack.shape[1], -1)
    squares = weight @ np.square(thin)
    left = squares - np.square(products[:, 1:]).sum(axis=1)
    flat = left <= _FLAT * squares + 1e-12
    explained = np.square(products[:, 0]) / np.where(flat, 1.0, left)
    energy = np.square(target).sum(axis=1)[:, None] + 1e-300
    share: Array = 1.0 - np.where(flat, 0.0, explained) / energy
    return share
