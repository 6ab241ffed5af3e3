"""The one-step criterion over every valve of a fine grid and every dead time at once.

A stick band and a dead time trade against each other where OP ramps, so neither may be fixed while
the other is searched. Their sums over all samples are a few matrix products for all
candidates together.
"""

from __future__ import annotations

import numpy as np

from estimator._kernels import Array, Mask
from estimator.search import MIN_MOVES, Seed, stem_of

__all__ = ["one_step_seeds"]

_PAST = 3
"""Past values of PV in the regression; enough to rank, the orders are chosen later."""

_LONGEST = 12
_WIDEST = 1.05
_NARROWEST = 0.015
_FINEST, _COARSEST = 0.002, 0.008
_SHARE_OF_STEP = 0.12
_RATIOS = (0.1, 0.4, 0.8)
_LEADS = (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1)
_STARTS = (*(0.5 * lead - 1.0 for lead in _LEADS), *(1.0 - 0.5 * lead for lead in _LEADS))
"""First positions by the lead to the first slip as a share of S, upwards and downwards."""
_CHUNK = 512
_CERTAIN = 0.9
_SETTLED_BY = 4


def one_step_seeds(u: Array, y: Array, good: Mask, count: int) -> tuple[Seed, ...]:
    """The best valves, apart from each other in stick band or dead time; best first.

    ``u`` and ``y`` are scaled OP and PV, shape ``(n,)``; ``good`` marks the samples that count.
    """
    axes = np.meshgrid(_bands(u), _RATIOS, _STARTS, indexing="ij")
    bands, ratios, starts = (axis.ravel() for axis in axes)
    longest = min(_LONGEST, u.size // 12)
    sums = _Sums(u, y, good, longest)
    costs = np.concatenate(
        [
            sums.costs(*(axis[i : i + _CHUNK] for axis in (bands, ratios, starts)))
            for i in range(0, bands.size, _CHUNK)
        ],
        axis=1,
    )
    found: list[Seed] = []
    apart = 1.5 * float(bands[len(_RATIOS) * len(_STARTS)] - bands[0])
    for flat in np.argsort(costs, axis=None, kind="stable"):
        row, j = divmod(int(flat), bands.size)
        cost = float(costs[row, j])
        if not np.isfinite(cost) or len(found) == count:
            break
        delay = row + 1
        if all(abs(s.band - bands[j]) > apart or abs(s.dead_time - delay) > 1 for s in found):
            found.append(Seed(float(bands[j]), float(ratios[j]), float(starts[j]), delay, cost))
    return tuple(found)


def _bands(u: Array) -> Array:
    """Stick bands a fraction of OP's step per sample apart: that decides when a valve slips."""
    steps = np.abs(np.diff(u))
    step = _SHARE_OF_STEP * float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    return np.arange(_NARROWEST, _WIDEST, min(max(step, _FINEST), _COARSEST))


class _Sums:
    """What least squares needs of a window, for every dead time, in one matrix."""

    def __init__(self, u: Array, y: Array, good: Mask, longest: int) -> None:
        self._u = np.ascontiguousarray(u)
        usable = good.copy()
        for i in range(1, _PAST + 1):
            usable[i:] &= good[:-i]
        usable[: max(_settled(u), longest + 2)] = False
        weight = usable.astype(np.float64)
        past = [np.ones(y.size), *(np.roll(y, i) for i in range(1, _PAST + 1))]
        basis, _ = np.linalg.qr(np.stack(past, axis=1) * weight[:, None])
        target = y * weight
        rest = target - basis @ (basis.T @ target)
        rows = np.vstack([rest, basis.T])
        offsets = range(1, longest + 2)
        self._rows = np.vstack([_early(rows, o) for o in offsets])
        self._weights = np.vstack([_early(weight[None], o) for o in offsets])
        self._energy = float(rest @ rest)
        self._longest = longest

    def costs(self, band: Array, ratio: Array, start: Array) -> Array:
        """Residual sum of squares, shape ``(dead times, m)``, from a dead time of 1 on."""
        stem, moves = stem_of(self._u, band, ratio, start)
        products = (self._rows @ stem).reshape(self._longest + 1, -1, band.size)
        own = self._weights @ np.square(stem)
        # x_(k-o) x_(k-o-1), summed with the weights of sample k
        neighbour = np.zeros_like(stem)
        neighbour[1:] = stem[1:] * stem[:-1]
        cross = self._weights @ neighbour
        right, shared = products[:, 0], products[:, 1:]
        g00 = own - np.square(shared).sum(axis=1)
        g11, r1 = g00[1:], right[1:]
        g01 = cross[:-1] - (shared[:-1] * shared[1:]).sum(axis=1)
        g00, r0 = g00[:-1] * (1.0 + 1e-9) + 1e-9, right[:-1]
        g11 = g11 * (1.0 + 1e-9) + 1e-9
        determinant = np.maximum(g00 * g11 - g01 * g01, 1e-12 * g00 * g11)
        explained = (g11 * r0 * r0 - 2.0 * g01 * r0 * r1 + g00 * r1 * r1) / determinant
        cost: Array = np.maximum(self._energy - explained, 1e-9 * self._energy)
        cost[:, moves < MIN_MOVES] = np.inf
        return cost


def _settled(u: Array) -> int:
    """The sample from which a valve's position no longer depends on where it was at the start."""
    reach = np.maximum.accumulate(u) - np.minimum.accumulate(u)
    certain = np.flatnonzero(reach >= _CERTAIN * reach[-1])
    return min(int(certain[0]) if certain.size else u.size, u.size // _SETTLED_BY)


def _early(rows: Array, samples: int) -> Array:
    """Rows earlier by ``samples``, so that their products with a signal are with its past."""
    out = np.zeros_like(rows)
    out[:, :-samples] = rows[:, samples:]
    return out
