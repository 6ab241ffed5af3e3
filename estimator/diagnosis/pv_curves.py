"""A healthy valve and a process whose gain changes with PV: heat losses, vessels, neutralisation.

Behind the dynamics PV is a curve of what a straight process gives (Wiener's structure). The same
curve backwards straightens PV, and the straight process is fitted to that. The curve backwards is
scaled by the geometric mean of its slope, so that likelihoods compare without a further term (Box
and Cox, An analysis of transformations, J. R. Stat. Soc. B 26, 1964, section 3).

Two curves are tried: an exponential, whose gain rises or falls with PV throughout, and a hyperbolic
sine, whose gain falls to both sides of PV's middle (the titration curve of a neutralisation).

Noise that grows with PV makes a curve likelier as well, with the straight process as good. So
the prediction is also judged in PV's own units, with noise of one size, and the lesser of the two
likelihoods counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.diagnosis.settings import Weighing
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import fit_noise
from estimator.search.processes import polish

__all__ = ["PvCurve", "StraightenedPv", "curves_of_pv"]

_LEAST_SLOPE = 1e-6
"""Slope that a curve keeps beyond what PV reached: a prediction may go there."""


@dataclass(frozen=True, slots=True)
class PvCurve:
    """How PV is straightened.

    Attributes:
        rate: e-foldings of the slope, one over the unit of PV.
        is_arched: whether it is the hyperbolic sine, of a gain that falls to both sides.
        middle: PV at which the slope is one.
    """

    rate: float
    is_arched: bool
    middle: float = 0.0

    def straighten(self, pv: Array) -> Array:
        """What PV ``(n,)`` would be of a straight process, zero in the middle."""
        turned = self.rate * (pv - self.middle)
        found: Array = (np.sinh(turned) if self.is_arched else np.expm1(turned)) / self.rate
        return found

    def bend(self, x: Array) -> Array:
        """The way back: PV of a straight process's ``(n,)``."""
        turned = self.rate * x
        if self.is_arched:
            return np.asarray(np.arcsinh(turned) / self.rate + self.middle)
        return np.asarray(np.log(np.maximum(1.0 + turned, _LEAST_SLOPE)) / self.rate + self.middle)

    def log_slope(self, pv: Array) -> Array:
        """Logarithm of the slope of `straighten`, ``(n,)``: minus that of the process's gain."""
        turned = self.rate * (pv - self.middle)
        return np.asarray(np.log(np.cosh(turned))) if self.is_arched else turned

    def in_units(self, centre: float, scale: float) -> PvCurve:
        """The curve of PV in its own units, of that of ``(PV - centre) / scale``."""
        return PvCurve(self.rate / scale, self.is_arched, centre + scale * self.middle)


@dataclass(frozen=True, slots=True)
class StraightenedPv:
    """A straight process of a straightened PV.

    Attributes:
        curve: how PV was straightened.
        case, fit: the straightened rows and the process on them.
        own: the same process judged by PV itself, its noise of one size there.
        price: what the search and the curve cost; with it the fit's likelihood is the lesser of
            the two, in nats.
    """

    curve: PvCurve
    case: Case
    fit: Hypothesis
    own: Hypothesis
    price: float


def curves_of_pv(case: Case, plain: Hypothesis, weighing: Weighing) -> list[StraightenedPv]:
    """The likeliest gain that changes with PV, as found and with its process settled.

    Args:
        case: the rows.
        plain: the healthy valve and a straight process on them.
        weighing: the curvatures that are tried.
    """
    span = float(np.ptp(case.rows.y[case.rows.weight > 0.0]))
    best: StraightenedPv | None = None
    for sizes, sides, is_arched in (
        (weighing.bends, (1.0, -1.0), False), (weighing.arches, (1.0,), True),
    ):  # fmt: skip
        for side in sides:
            last = -math.inf
            for size in sizes:
                found = _fit(case, plain, PvCurve(side * size / span, is_arched))
                worth = found.fit.likelihood - found.price
                if best is None or worth > best.fit.likelihood - best.price:
                    best = found
                if worth < last:
                    # the likelihood falls away on both sides of its top
                    break
                last = worth
    if best is None:
        return []
    return [best, _fit(case, best.fit, best.curve)]


def _fit(case: Case, start: Hypothesis, curve: PvCurve) -> StraightenedPv:
    rows = case.rows
    slope = float(np.sum(rows.weight * curve.log_slope(rows.y))) / rows.count
    straight = math.exp(-slope) * curve.straighten(rows.y)
    bent = replace(case, rows=replace(rows, y=straight))
    fit = polish(bent, None, start, (), start.taps, wide=True)
    residual = rows.y - curve.bend(math.exp(slope) * (straight - fit.residual))
    taps = fit_noise(rows, residual, case.settings.modelling)
    squares = float(np.sum(np.square(filter_rows(residual[None], taps, rows.weight)[0])))
    likelihood = case.log_likelihood(squares) - case.price(fit.poles, (), taps, valve=False)
    own = replace(fit, taps=taps, squares=squares, residual=residual, likelihood=likelihood)
    price = 0.5 * math.log(rows.count) + max(0.0, fit.likelihood - own.likelihood)
    return StraightenedPv(curve, bent, fit, own, price)
