"""Intervals: the likelihood over stick band, slip jump and first slip, integrated.

The likelihood in S and J is no parabola. The valve slips at one sample or at the next, so it has
plateaus and steps, and its maximum sits anywhere on a plateau: a fixed drop below the maximum (the
chi-square rule) is then too short an interval, and the maximum itself is a biased estimate of J,
because whatever mistakes the time of a slip also flattens the stem's jumps against PV. Treated as a
density (uniform in ln S, in J over S, and in how far OP goes until the first slip, the *lead*, over
S: valves have no scale of their own) the likelihood gives quantiles that are right for plateaus and
slopes alike.

It has several peaks as well: a longer dead time with a narrower band gives nearly the same PV. A
climb from the best valve sees one of them. So the density is a mixture of boxes: sets of slips
that were listed without a gap (`estimator.listed`), or cells of a grid around each optimum of the
search (`estimator.zoomed`). Within a box it is uniform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from estimator._kernels import Array
from estimator.result import Interval

__all__ = ["Peak", "Posterior"]

_TEMPER = 0.5
"""Share of the log-likelihood that counts: orders and poles were chosen on the same samples.
Chosen so that intervals cover the truth as often as they say on the closed-loop examples of the
paper."""
_ALIVE = 1e-5
_LEFT_OUT = 1e-4
"""Share of the probability that quantiles do without: the least likely boxes'."""
_STEEP = 1e9
"""A gain that is as good as infinite, in scaled units."""
_APART, _SHARE = 0.02, 0.1
_HALF = np.array([0.42, 0.85, 1.25, 1.645, 2.1, 2.6, 3.5])
_EDGES = np.concatenate([-_HALF[::-1], [0.0], _HALF])
_PARTS = np.diff(ndtr(_EDGES))
"""A normal law as a staircase, exact at its edges."""


@dataclass(frozen=True, slots=True)
class Peak:
    """A valve and the share of the probability around it."""

    band: float
    jump: float
    share: float


@dataclass(frozen=True, slots=True)
class Posterior:
    """Boxes of valves with the likelihood of one of each.

    Attributes:
        nodes: S, J and lead of the valve that stands for its box, shape ``(m, 3)``.
        low, high: ends of S and J of the box, shape ``(m, 2)``.
        volume: of the box, the lead's extent included, shape ``(m,)``.
        log_likelihood, gain: of the valve, shape ``(m,)``.
    """

    nodes: Array
    low: Array
    high: Array
    volume: Array
    log_likelihood: Array
    gain: Array

    def joined(self, other: Posterior) -> Posterior:
        """The boxes of both."""
        pairs = [(getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__]
        return Posterior(*(np.concatenate(pair) for pair in pairs))

    @property
    def best(self) -> Array:
        """Stick band, slip jump and lead of the most likely valve."""
        return np.asarray(self.nodes[int(self.log_likelihood.argmax())], dtype=np.float64)

    @property
    def weight(self) -> Array:
        """Probability of each box, shape ``(m,)``."""
        log = np.where(self.volume > 0.0, self.log_likelihood, -np.inf)
        relative = self.volume / np.maximum(self.nodes[:, 0], 1e-12) ** 3
        weight = relative * np.exp(_TEMPER * (log - log.max()))
        return np.asarray(weight / weight.sum(), dtype=np.float64)

    def peaks(self, apart: float = _APART, share: float = _SHARE) -> tuple[Peak, ...]:
        """Valves that explain the window about equally well, most probable first.

        Peaks are ``apart`` in S, as a share of it, with nothing between, and hold a ``share`` of
        the probability each.
        """
        weight = self.weight
        alive = np.flatnonzero(weight > _ALIVE)
        order = alive[np.argsort(self.nodes[alive, 0], kind="stable")]
        band = self.nodes[order, 0]
        parts = np.split(order, 1 + np.flatnonzero(np.diff(band) > apart * band[1:]))
        found = []
        for part in parts:
            mass = float(weight[part].sum())
            if mass >= share:
                top = part[int(self.log_likelihood[part].argmax())]
                found.append(Peak(float(self.nodes[top, 0]), float(self.nodes[top, 1]), mass))
        return tuple(sorted(found, key=lambda peak: -peak.share))

    def interval(
        self, of_band: float, of_jump: float, confidence: float, blur: float = 0.0
    ) -> Interval:
        """Median and equal-tailed interval of ``of_band S + of_jump J``.

        ``blur`` is the standard deviation that the quantity has for each single valve.
        """
        parts = np.array([of_band, of_jump])
        ends = np.stack([self.low * parts, self.high * parts])
        return self._quantiles(
            ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1), confidence, blur
        )

    def gain_interval(self, confidence: float, deviation: float) -> Interval:
        """The same of the gain, which has the standard deviation ``deviation`` for each valve.

        Anything where that is infinite.
        """
        if not np.isfinite(deviation):
            return Interval(np.inf, -np.inf, np.inf)
        gain = np.clip(self.gain, -_STEEP, _STEEP)
        return self._quantiles(gain, gain, confidence, deviation)

    def _quantiles(self, low: Array, high: Array, confidence: float, blur: float) -> Interval:
        weight = self.weight
        order = np.argsort(-weight, kind="stable")
        alive = order[: 1 + int(np.searchsorted(np.cumsum(weight[order]), 1.0 - _LEFT_OUT))]
        # boxes of different leads have the same ends
        ends, same = np.unique(low[alive] + 1j * high[alive], return_inverse=True)
        low, high = ends.real, ends.imag
        weight = np.bincount(same, weights=weight[alive]).astype(np.float64)
        if blur > 0.0:
            low = (low[:, None] + blur * _EDGES[:-1]).ravel()
            high = (high[:, None] + blur * _EDGES[1:]).ravel()
            weight = (weight[:, None] * _PARTS).ravel()
        tail = 0.5 * (1.0 - confidence)
        found = _mixture_quantiles(low, high, weight, np.array([tail, 0.5, 1.0 - tail]))
        return Interval(float(found[1]), float(found[0]), float(found[2]))


def _mixture_quantiles(low: Array, high: Array, weight: Array, shares: Array) -> Array:
    """Quantiles of a mixture of uniform distributions from ``low`` to ``high``."""
    width = np.maximum(high - low, 1e-12 * max(1e-12, float(np.abs(high).max())))
    density = weight / weight.sum() / width
    at = np.concatenate([low, low + width])
    order = np.argsort(at, kind="stable")
    at = at[order]
    slope = np.cumsum(np.concatenate([density, -density])[order])
    share = np.concatenate([[0.0], np.cumsum(slope[:-1] * np.diff(at))])
    found: Array = np.interp(shares, np.maximum.accumulate(share), at)
    return found
