"""The discrete algebraic Riccati equation by doubling.

A dead time puts as many states with an eigenvalue of zero into the equation. Solvers that order
the eigenvalues of its pencil (SciPy's `solve_discrete_are`) then fail now and then, by the last
digit of what they are given. Doubling orders nothing: each pass makes the horizon of the regulator
twice as long, until it counts as endless.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError

__all__ = ["solve_riccati"]

Array = NDArray[np.float64]

_PASSES = 60
"""Horizons of 2, 4, ... 2^60 samples: poles within 1e-16 of the unit circle have settled."""
_SETTLED = 1e-14
"""Relative change of a pass after which the horizon counts as endless."""


def solve_riccati(A: Array, b: Array, Q: Array, r: float, cross: Array | None = None) -> Array:
    """Return the stabilising ``X``, shape ``(n, n)``, of

        X = A^T X A - (A^T X b + s) (r + b^T X b)^-1 (A^T X b + s)^T + Q

    Source: structure-preserving doubling; Chu, Fan, Lin and Wang, International Journal of Control
    77 (2004) 767-788.

    Args:
        A: shape ``(n, n)``.
        b: shape ``(n,)``, the single input.
        Q: shape ``(n, n)``, symmetric; with ``cross`` taken out not negative.
        r: price of the input, above zero.
        cross: ``s``, shape ``(n,)``; zero when None.

    Raises:
        CompensatorError: no solution: a pole on or outside the unit circle that the input does not
            move or the cost does not see.
    """
    if cross is not None:
        A = A - np.outer(b, cross) / r
        Q = Q - np.outer(cross, cross) / r
    identity = np.eye(A.shape[0])
    G: Array = np.outer(b, b) / r
    X: Array = Q
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_PASSES):
            try:
                shared = np.linalg.solve(identity + G @ X, np.hstack([A, G]))
            except np.linalg.LinAlgError:
                break
            onward, reached = np.hsplit(shared, 2)
            grown = X + A.T @ X @ onward
            G = G + A @ reached @ A.T
            A = A @ onward
            G, grown = 0.5 * (G + G.T), 0.5 * (grown + grown.T)
            change = float(np.abs(grown - X).max())
            X = grown
            if not np.isfinite(change):
                break
            if change <= _SETTLED * float(np.abs(X).max()):
                return X
    raise CompensatorError(
        "the Riccati equation has no solution: a pole on or outside the unit circle is not moved, "
        "or not seen"
    )
