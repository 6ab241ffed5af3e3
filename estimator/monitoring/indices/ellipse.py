"""Apparent stiction: how wide in OP is the ellipse that PV draws over OP?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from estimator.monitoring.indices._signals import Array, detrended, pair
from estimator.monitoring.indices.oscillation import oscillation

__all__ = ["Ellipse", "apparent_stiction"]


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse fitted to PV over OP.

    Attributes:
        apparent_stiction: its width in OP at the PV of its centre, in units of OP; NaN when the
            points draw no ellipse.
        period_s: period of the oscillation that was kept; NaN when the signals were not filtered.
    """

    apparent_stiction: float
    period_s: float


def _kept(values: Array, period: float) -> Array:
    """The part of a signal with periods from a quarter to four times ``period`` (samples)."""
    spectrum = np.fft.rfft(values)
    frequency = np.fft.rfftfreq(values.size)
    spectrum[(frequency < 0.25 / period) | (frequency > 4.0 / period)] = 0.0
    return np.fft.irfft(spectrum, values.size)


def _width(x: Array, y: Array) -> float:
    """Width along ``x``, through its centre, of the ellipse fitted by direct least squares."""
    quadratic = np.column_stack([x * x, x * y, y * y])
    linear = np.column_stack([x, y, np.ones_like(x)])
    s2 = quadratic.T @ linear
    s3 = linear.T @ linear
    if np.linalg.cond(s3) > 1e12:
        return math.nan
    to_linear = -np.linalg.solve(s3, s2.T)
    reduced = quadratic.T @ quadratic + s2 @ to_linear
    # Halir and Flusser's constraint 4ac - b^2 = 1 turns the fit into this eigenvalue problem.
    reduced = np.array([reduced[2] / 2.0, -reduced[1], reduced[0] / 2.0])
    vectors = np.real(scipy.linalg.eig(reduced)[1])
    fits = 4.0 * vectors[0] * vectors[2] - vectors[1] ** 2
    if fits.max() <= 0.0:
        return math.nan
    a, b, c = vectors[:, int(np.argmax(fits))]
    d, e, f = to_linear @ np.array([a, b, c])
    centre = np.linalg.solve(np.array([[2 * a, b], [b, 2 * c]]), [-d, -e])
    level = f + 0.5 * float(np.dot([d, e], centre))
    square = -level / a
    return 2.0 * math.sqrt(square) if square > 0.0 else math.nan


def apparent_stiction(op: ArrayLike, pv: ArrayLike, *, period: float = 1.0) -> Ellipse:
    """Choudhury's apparent stiction: the width in OP of the ellipse that PV draws over OP.

    Both signals are first reduced to the neighbourhood of the oscillation, when there is a regular
    one. "Apparent" because the process widens or narrows the ellipse too: it is a starting value
    for ``S = fS + fD``, no estimate.

    Args:
        op, pv: samples, shape ``(n,)``, NaN where bad.
        period: seconds between samples.

    Raises:
        EstimatorError: not vectors of one length, or too few usable samples.

    Source: Choudhury, Shah, Thornhill and Shook (2006), "Automatic detection and quantification of
    stiction in control valves", Control Engineering Practice 14, 1395-1412; fit: Halir and Flusser
    (1998), "Numerically stable direct least squares fitting of ellipses".
    """
    u, y = pair(op, pv)
    good = np.isfinite(u)
    flat_u, flat_y = detrended(u), detrended(y)
    swing = oscillation(flat_u)
    period_s = math.nan
    if swing.is_regular:
        flat_u, flat_y = _kept(flat_u, swing.period_s), _kept(flat_y, swing.period_s)
        period_s = swing.period_s * period
    x, v = flat_u[good], flat_y[good]
    scale_x, scale_v = float(x.std()), float(v.std())
    if scale_x == 0.0 or scale_v == 0.0:
        return Ellipse(math.nan, period_s)
    return Ellipse(scale_x * _width(x / scale_x, v / scale_v), period_s)
