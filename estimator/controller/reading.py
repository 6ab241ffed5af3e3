"""The running controller, read off OP, PV and SP: OP is its answer to the error.

    found = read_controller(op, pv, sp, period=1.0)
    found.structure, found.gain, found.integral_time_s

In velocity form every term of a PID controller is linear in what is recorded,

    OP_k - OP_(k-1) = a (OP_(k-1) - OP_(k-2)) + Kc [(e_k - e_(k-1)) + h/Ti e_k + D_k] + noise,

with ``e = SP - PV``, D the second difference of the error or of PV, and ``a`` the pole of a filter.
Where the record is what the controller saw, the equation holds to rounding and its shortest form
is found exactly. Where the record is noisy, differences hold mostly noise; summed over more and
more samples they hold less of it, and the sums are instrumented by what was recorded before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array, Mask
from estimator.controller.controller import Controller, from_filtered, from_fit
from estimator.controller.filtered import fit_filtered
from estimator.controller.fits import (
    TIE,
    Fit,
    fit_columns,
    fit_instrumented,
    triangle_of,
)
from estimator.controller.settings import READING, Reading
from estimator.controller.shifts import shifted
from estimator.window import bridge, carry_on

__all__ = ["Aligned", "at_limit", "read_aligned", "read_controller"]


_LATE = (0, 1, 2)
"""Samples by which PV may be recorded later than OP."""
_ROUNDED = 2.0
"""Times the variance of the record's rounding that a law may leave for all that it leaves to be
rounding: some values repeat, and their errors do."""
_ONE = 1e-9
"""Of a signal's span: values that are nearer are one."""
_STEPS, _ALIKE = 10.0, 1e-6
"""Steps of the record that OP's largest move must be, and share of it that moves may differ by, to
be a limit of the moves."""
_MEASURED = (1e-100, 1e100)
"""Largest values of PV and error whose squares, and those of gains from them, are numbers. What
lies outside was never measured: so look floats whose registers are in the other order."""
_CANDIDATES = (
    ("p",), ("i",), ("p", "i"), ("p", "i", "d"), ("p", "i", "dpv"), ("i", "ppv"),
    ("p", "i", "f"), ("p", "i", "d", "f"), ("p", "i", "dpv", "f"),
)  # fmt: skip


def read_controller(
    op: ArrayLike,
    pv: ArrayLike,
    sp: ArrayLike | None = None,
    *,
    auto: ArrayLike | None = None,
    period: float = 1.0,
    settings: Reading = READING,
) -> Controller | None:
    """Read structure and settings of the controller.

    Args:
        op, pv, sp: samples, shape ``(n,)``, NaN where bad; ``sp`` stands until its next value,
            and is taken as constant where there is none.
        auto: non-zero where the controller is in automatic, shape ``(n,)``; other rows do not
            count, nor do those in which OP is at its highest or lowest value for a while, or
            moves as fast as it may.
        period: seconds between samples.
        settings: see `estimator.controller.settings`.

    Returns:
        The controller; None where OP does not answer the error: manual, a constant, or another
        signal, or one that nobody can have measured (below 1e-100, above 1e100).

    Source: the regression is the textbook velocity form (Astrom and Hagglund, Advanced PID Control,
    2006, section 3.4); instruments against noise: Soderstrom and Stoica (1983).
    """
    given = _prepare(op, pv, sp, auto, settings)
    if given is None:
        return None
    found = _read_exactly(given, period, settings)
    return found or _read_noisy(given, period, settings)


@dataclass(frozen=True, slots=True)
class Aligned:
    """PV ``(n,)`` as the controller saw it.

    Attributes:
        pv: moved forward by ``late`` samples, the last ones NaN.
        late: samples by which PV was recorded later than OP.
        controller: what explains OP's moves to rounding, its times in samples; None where nothing
            does.
    """

    pv: Array
    late: int
    controller: Controller | None


def read_aligned(op: Array, pv: Array, sp: Array | None, settings: Reading = READING) -> Aligned:
    """PV as the controller saw it, where that shows: ``(n,)`` each, NaN where bad.

    A historian that polls one signal after the other may store PV a sample or two after OP. Then
    OP's moves are explained to rounding only once PV is moved forward. PV stays as it is where they
    never are.
    """
    for late in _LATE:
        moved = shifted(pv, late)
        given = _prepare(op, moved, sp, None, settings)
        found = None if given is None else _read_exactly(given, 1.0, settings)
        if found is not None:
            return Aligned(moved, late, found)
    return Aligned(pv, 0, None)


@dataclass(frozen=True, slots=True)
class _Given:
    """Signals without holes, ``(n,)``, and the rows that count."""

    u: Array
    y: Array
    e: Array
    rows: Mask


def _prepare(
    op: ArrayLike,
    pv: ArrayLike,
    sp: ArrayLike | None,
    auto: ArrayLike | None,
    settings: Reading,
) -> _Given | None:
    u, y = bridge(op), bridge(pv)
    target = None if sp is None else carry_on(sp)
    e = -y if target is None else target - y
    span = float(np.ptp(u))
    if u.size < settings.least_rows or span <= 1e-9 * max(1.0, float(np.abs(u).max())):
        return None
    for answered in (y, e):
        largest = float(np.abs(answered).max())
        if largest > _MEASURED[1] or 0.0 < largest < _MEASURED[0]:
            return None
    rows = _usable(op, pv, auto, u)
    return _Given(u, y, e, rows) if int(rows.sum()) >= settings.least_rows else None


def _read_exactly(given: _Given, period: float, settings: Reading) -> Controller | None:
    u, rows = given.u, given.rows
    best = _best(u, given.y, given.e, rows, settings)
    if best is None:
        return None
    moves = np.diff(u)[rows[1:]]
    whole = float(np.mean((moves - moves.mean()) ** 2))
    if not whole > 0.0:
        return None
    found = from_fit(best, period, 1.0 - best.squares / best.rows / whole)
    if not _is_rounding(best, found, given, whole, period, settings):
        other = fit_filtered(u, given.y, given.e, rows, settings.resolution)
        if other is not None:
            again = from_filtered(other, period, 1.0 - other.fit.squares / other.fit.rows / whole)
            is_exact = again.explained > settings.exact
            if is_exact and _is_rounding(other.fit, again, given, whole, period, settings):
                return replace(again, exact=True)
        return found if found.explained > settings.exact else None
    return replace(found, exact=found.explained > settings.exact)


def _is_rounding(
    fit: Fit, of: Controller, given: _Given, whole: float, period: float, settings: Reading
) -> bool:
    """Whether the record's rounding makes all that a law leaves of OP's moves."""
    pole = math.exp(-period / of.filter_time_s) if of.filter_time_s > 0.0 else 0.0
    proportional, integral = of.gain, of.integral_rate * period
    derivative = of.gain * of.derivative_time_s / period
    on_op = np.array([1.0, -1.0 - pole, pole])
    on_pv = (1.0 - pole) * np.array(
        [proportional + integral + derivative, -proportional - 2.0 * derivative, derivative]
    )
    steps = _resolution(given.u), _resolution(given.y)
    made = float(on_op @ on_op) * steps[0] ** 2 + float(on_pv @ on_pv) * steps[1] ** 2
    return fit.squares / fit.rows <= _ROUNDED * made / 12.0 + settings.resolution * whole


def _resolution(x: Array) -> float:
    """The least difference of two values of a signal ``(n,)``."""
    steps = np.diff(np.unique(x))
    steps = steps[steps > _ONE * float(np.ptp(x))]
    return float(steps.min()) if steps.size else 0.0


def _usable(op: ArrayLike, pv: ArrayLike, auto: ArrayLike | None, u: Array) -> Mask:
    """Samples with a good present and past, in automatic, OP not at a limit."""
    good: Mask = np.isfinite(np.asarray(op, dtype=float))
    good &= np.isfinite(np.asarray(pv, dtype=float))
    if auto is not None:
        good &= np.asarray(auto, dtype=float) > 0.0
    good &= ~at_limit(u) & ~_at_fastest(u)
    # noise lets OP touch a limit for one sample: a value that comes back exactly is no chance
    reach = 1e-6 * float(np.ptp(u))
    for extreme in (float(u.min()), float(u.max())):
        touches = np.abs(u - extreme) <= reach
        if int(touches.sum()) > 1:
            good &= ~touches
    usable: Mask = good.copy()
    for late in (1, 2, 3):
        usable[late:] &= good[:-late]
    usable[:3] = False
    return usable


def at_limit(u: Array) -> Mask:
    """Samples at the highest or lowest value of a signal where it stays there, ``(n,)``."""
    found = np.zeros(u.size, dtype=bool)
    reach = 1e-6 * float(np.ptp(u))
    for at in (u <= u.min() + reach, u >= u.max() - reach):
        stays = at[1:] & at[:-1]
        found[1:] |= stays
        found[:-1] |= stays
    return found


def _at_fastest(u: Array) -> Mask:
    """Samples ``(n,)`` in which OP moves by its largest move, and that more than once.

    So a limit of the moves shows. Where the largest is a few steps of the record, rounding makes
    moves alike.
    """
    moves = np.abs(np.diff(u))
    fastest = float(moves.max())
    found = np.zeros(u.size, dtype=bool)
    found[1:] = moves >= (1.0 - _ALIKE) * fastest
    is_limited = int(found.sum()) > 1 and fastest > _STEPS * _resolution(u)
    return found & is_limited


def _columns(u: Array, y: Array, e: Array, delay: int) -> dict[str, Array]:
    """What each term adds to OP's move, ``(n - 3,)`` from sample 3 on."""
    n = u.size

    def at(x: Array, by: int) -> Array:
        index = np.maximum(np.arange(3, n) - by - delay, 0)
        return np.asarray(x[index])

    return {
        "p": at(e, 0) - at(e, 1),
        "ppv": -(at(y, 0) - at(y, 1)),
        "i": at(e, 0),
        "d": at(e, 0) - 2.0 * at(e, 1) + at(e, 2),
        "dpv": -(at(y, 0) - 2.0 * at(y, 1) + at(y, 2)),
        "f": u[2 : n - 1] - u[1 : n - 2],
        "one": np.ones(n - 3),
    }


def _best(u: Array, y: Array, e: Array, rows: Mask, settings: Reading) -> Fit | None:
    """The likeliest of the shortest forms by plain least squares on OP's moves."""
    moves = (u[3:] - u[2:-1])[rows[3:]]
    if float(np.ptp(moves)) == 0.0:
        return None
    floor = settings.resolution * float(np.mean(moves**2))
    best, least = None, math.inf
    for delay in (0, 1):
        columns = {term: one[rows[3:]] for term, one in _columns(u, y, e, delay).items()}
        triangle = triangle_of([*columns.values(), moves])
        short = dict(zip(columns, triangle.T, strict=False))
        for terms in _CANDIDATES:
            fit = fit_columns(terms, delay, short, triangle[:, -1], moves.size)
            if fit.is_sensible and (cost := fit.cost(floor)) < least - TIE:
                best, least = (fit, columns), cost
    if best is None:
        return None
    fit, columns = best
    # once more from the rows: the cycle of a sticky valve, simulated, multiplies rounding
    return fit_columns(fit.terms, fit.delay, columns, moves, moves.size)


def _read_noisy(given: _Given, period: float, settings: Reading) -> Controller | None:
    """PI or P settings from sums over several samples, instrumented by the record before them."""
    u, e, rows = given.u, given.e, given.rows
    best, found = -math.inf, None
    n = u.size
    sums = np.concatenate([[0.0], np.cumsum(e)])
    whole = np.concatenate([[0], np.cumsum(~rows)])
    for reach in settings.reaches:
        if n < 8 * reach:
            continue
        k = np.arange(2 * reach, n)
        clean = (whole[k + 1] - whole[k - 2 * reach]) == 0
        k = k[clean]
        if k.size < max(settings.least_rows, 4 * reach):
            continue
        moves = u[k] - u[k - reach]
        p = e[k] - e[k - reach]
        i = sums[k + 1] - sums[k + 1 - reach]
        # what was recorded before the interval shares the loop's motion and not the noise
        before = [
            e[k - 1] - e[k - 1 - reach] if reach > 1 else e[k - 1],
            sums[k] - sums[k - reach],
            e[k - 1 - reach // 2] - e[k - reach - reach // 2],
            u[k - 1] - u[k - reach] if reach > 1 else u[k - 1] - u[k - 2],
        ]
        ones = np.ones(k.size)
        tools = np.stack([*before, ones], axis=1)
        tools = tools / (tools.std(axis=0) + np.abs(tools.mean(axis=0)) + 1e-300)
        columns = np.stack([p, i, ones], axis=1)
        columns = columns - columns.mean(axis=0) * np.array([1.0, 1.0, 0.0])
        total = float(np.sum((moves - moves.mean()) ** 2))
        if not total > 0.0:
            continue
        triangle = triangle_of([*tools.T, *columns.T, moves])
        parts = triangle[:, :5], triangle[:, 5:8], triangle[:, 8]
        for terms, used in ((("p", "i"), [0, 1, 2]), (("p",), [0, 2]), (("i",), [1, 2])):
            fit = fit_instrumented(terms, used, *parts, k.size)
            share = 1.0 - fit.squares / total - 0.01 * len(terms)
            if fit.is_sensible and share > best + TIE:
                best, found = share, (terms, used, tools, columns, moves, k.size)
    if found is None or best < settings.least_explained:
        return None
    return from_fit(fit_instrumented(*found), period, best, timed=False)
