"""Controllers whose filter is not in series: on the derivative alone, or on PV while SP goes past.

With the filter's pole ``a`` such a law is linear in the rest: both sides are taken at
``x_k - a x_(k-1)``, which needs no past beyond a sample, and the pole is found by a search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy

from estimator.arrays import Array, Mask
from estimator.controller.fits import TIE, Fit, fit_columns, left_by_pole, triangle_of

__all__ = ["Filtered", "fit_filtered"]

_POLES = (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
"""Poles from which the search begins."""
_LAST_POLE = 0.98
"""Largest pole of a filter: slower ones are an integral."""
_REFINED = 3
"""Likeliest forms whose pole is searched for further."""
_FORMS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("derivative", ("p", "i", "d")),
    ("derivative", ("p", "i", "dpv")),
    ("pv", ("p", "i")),
    ("pv", ("p", "i", "d")),
)


@dataclass(frozen=True, slots=True)
class Filtered:
    """A law with such a filter.

    Attributes:
        on: ``"derivative"`` or ``"pv"``, what is filtered.
        pole: of the filter.
        fit: of the law's terms; its derivative is that of slow motions.
    """

    on: str
    pole: float
    fit: Fit


def fit_filtered(u: Array, y: Array, e: Array, rows: Mask, resolution: float) -> Filtered | None:
    """The likeliest of the shortest forms; ``(n,)`` each, without holes; None if none is sensible.

    ``resolution`` is the share of the moves' mean square that rounding leaves at least.
    """
    tried = []
    whole = {delay: _Parts.of(u, y, e, rows, delay) for delay in (0, 1)}
    floor = resolution * float(np.mean(whole[0].moves ** 2))
    for delay, parts in whole.items():
        short = parts.in_triangle()
        for on, terms in _FORMS:
            pair = _at_ends(short, on, terms)
            left = left_by_pole(*pair, np.array(_POLES))
            tried.append((float(left.min()), delay, on, terms, short, pair, int(left.argmin())))
    tried.sort(key=lambda one: one[0])
    best, least = None, math.inf
    for _, delay, on, terms, short, pair, start in tried[:_REFINED]:
        pole = _best_pole(pair, start)
        found = Filtered(on, pole, _fit(short, on, terms, pole, delay))
        if found.fit.is_sensible and (cost := found.fit.cost(floor)) < least - TIE:
            best, least = found, cost
    if best is None:
        return None
    # once more from the rows: less of it is rounding
    delay, terms = best.fit.delay, best.fit.terms
    return replace(best, fit=_fit(whole[delay], best.on, terms, best.pole, delay))


@dataclass(frozen=True, slots=True)
class _Parts:
    """OP's moves and what they answer, now and before, ``(m,)`` each of so many ``rows``."""

    moves: Array
    old_moves: Array
    e: Array
    old_e: Array
    older_e: Array
    y: Array
    old_y: Array
    older_y: Array
    one: Array
    rows: int

    @classmethod
    def of(cls, u: Array, y: Array, e: Array, rows: Mask, delay: int) -> _Parts:
        """These of the rows that count."""
        k = np.arange(3, u.size)[rows[3:]]

        def at(x: Array, by: int) -> Array:
            return np.asarray(x[np.maximum(k - by - delay, 0)])

        return cls(
            u[k] - u[k - 1], u[k - 1] - u[k - 2], at(e, 0), at(e, 1), at(e, 2),
            at(y, 0), at(y, 1), at(y, 2), np.ones(k.size), k.size,
        )  # fmt: skip

    def in_triangle(self) -> _Parts:
        """The same in few rows: least squares among sums of any of them are the same."""
        names = [one.name for one in fields(self)[:-1]]
        whole = triangle_of([getattr(self, name) for name in names])
        return replace(self, **dict(zip(names, whole.T, strict=True)))


def _fit(parts: _Parts, on: str, terms: tuple[str, ...], a: float, delay: int) -> Fit:
    columns = _columns(parts, on, a)
    return fit_columns(terms, delay, columns, parts.moves - a * parts.old_moves, parts.rows)


def _columns(parts: _Parts, on: str, a: float) -> dict[str, Array]:
    # of PV alone where that is filtered: a set-point step would be a blow
    on_pv = -(1.0 - a) * (parts.y - 2.0 * parts.old_y + parts.older_y)
    if on == "pv":
        now, old, older = (
            parts.e + parts.y, parts.old_e + parts.old_y, parts.older_e + parts.older_y,
        )  # fmt: skip
        error = (now - a * old) - (1.0 - a) * parts.y
        before = (old - a * older) - (1.0 - a) * parts.old_y
        return {"p": error - before, "i": error, "d": on_pv, "one": parts.one}
    steps, before = parts.e - parts.old_e, parts.old_e - parts.older_e
    return {
        "p": steps - a * before,
        "i": parts.e - a * parts.old_e,
        "d": (1.0 - a) * (steps - before),
        "dpv": on_pv,
        "one": parts.one,
    }


def _at_ends(parts: _Parts, on: str, terms: tuple[str, ...]) -> tuple[Array, Array]:
    """OP's moves and the columns of some terms with the poles 0 and 1: linear between."""
    rows = []
    for a in (0.0, 1.0):
        columns = _columns(parts, on, a)
        rows.append(np.stack([parts.moves - a * parts.old_moves, *(columns[t] for t in terms)]))
    ones = parts.one
    return np.vstack([rows[0], ones]), np.vstack([rows[1], ones])


def _best_pole(pair: tuple[Array, Array], start: int) -> float:
    """The best pole between the neighbours of the one of that place."""
    ends = (0.0, *_POLES, _LAST_POLE)
    found = scipy.optimize.minimize_scalar(
        lambda a: left_by_pole(*pair, np.array([a]))[0],
        bounds=(ends[start], ends[start + 2]),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return float(found.x)
