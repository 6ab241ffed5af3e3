"""Where the paper's optimisation starts: the triangle's boundary and the ellipse (section 3)."""

from __future__ import annotations

import math

import numpy as np

from estimator.outcomes import EstimatorError

__all__ = ["starting_frictions"]

Pair = tuple[float, float]


def _edge(first: Pair, last: Pair, step: float) -> list[Pair]:
    points = max(2, round(max(abs(last[0] - first[0]), abs(last[1] - first[1])) / step) + 1)
    static = np.linspace(first[0], last[0], points)
    dynamic = np.linspace(first[1], last[1], points)
    return [(float(a), float(b)) for a, b in zip(static, dynamic, strict=True)]


def _thinned(points: list[Pair], count: int) -> list[Pair]:
    if count >= len(points):
        return points
    chosen = np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))
    return [points[i] for i in chosen]


def starting_frictions(
    span: float, apparent_stiction: float, *, count: int = 7, step: float = 0.5
) -> tuple[Pair, ...]:
    """``count`` pairs ``(fS, fD)`` to start from, always the same for the same input.

    Three lie on ``fS + fD = S0``, the apparent stiction of the ellipse fit, with a slip jump of
    none, half and all of it; the others lie evenly on the two inner edges of the triangle
    (``fD = 0`` and ``fS = fD``), out to where the valve would never move (``fS + fD = span``).

    Args:
        span: of OP in the window.
        apparent_stiction: ``S0``, NaN when there is no ellipse: then all starts lie on the edges.
        count: the paper's M.
        step: distance of points on the edges, in units of OP.

    Raises:
        EstimatorError: count below 1, or span or step not positive.
    """
    if count < 1 or not span > 0.0 or not step > 0.0:
        raise EstimatorError(
            f"starts need count >= 1, span > 0 and step > 0; got {count}, {span!r}, {step!r}"
        )
    inner: list[Pair] = []
    if math.isfinite(apparent_stiction) and apparent_stiction > 0.0:
        s0 = min(apparent_stiction, 0.9 * span)
        inner = [(0.75 * s0, 0.25 * s0), (0.5 * s0, 0.5 * s0), (s0, 0.0)][:count]
    # The corner (0, 0) is the healthy valve, whose derivatives say nothing: edges begin beside it.
    near = min(step, 0.1 * span)
    far = 0.9 * span
    without = _edge((near, 0.0), (far, 0.0), step)
    equal = _edge((0.5 * far, 0.5 * far), (near, near), step)
    return tuple(inner + _thinned(without + equal, count - len(inner)))
