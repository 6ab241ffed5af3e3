"""ARMAX(na, nb, nc) with intercept for a given stem: equation (7) with coloured noise.

``A(q) y_k = B(q) x_(k-d) + c + C(q) e_k``, ``e`` white. White measurement noise on PV is the case
``C = A``: ARX (the paper's choice, ``C = 1``) is then biased in poles and gain, ARMAX is not.

The start is Hannan and Rissanen's: a long ARX gives the innovations, least squares on them the
coefficients. From there Gauss-Newton minimises the one-step prediction error ``e = (A y - B x - c)
/ C``; the step is halved until the error falls and C stays invertible.

Sources: Hannan and Rissanen, Recursive estimation of mixed autoregressive-moving average order,
Biometrika 69 (1982) 81-94; Ljung, System Identification, 2nd ed. (1999), (4.14)-(4.19) for the
predictor, section 10.2 for the search, (9.42) for the covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from estimator.arrays import Array, Mask
from estimator.outcomes import EstimatorError
from loop_model import ProcessModel

__all__ = ["ArmaxFit", "ArmaxOrders", "armax"]

_STEPS = 40
_HALVINGS = 12
_CONVERGED = 1e-10
_INVERTIBLE = 0.999
_LONG = 4


@dataclass(frozen=True, slots=True)
class ArmaxOrders:
    """Coefficients of A, B and C, and samples from stem to PV (``dead_time`` 0 is feed-through)."""

    na: int
    nb: int
    nc: int
    dead_time: int = 1

    def __post_init__(self) -> None:
        if self.na < 0 or self.nb < 1 or self.nc < 0 or self.dead_time < 0:
            raise EstimatorError(
                "ARMAX needs na >= 0, nb >= 1, nc >= 0 and dead_time >= 0; got "
                f"na = {self.na}, nb = {self.nb}, nc = {self.nc}, dead_time = {self.dead_time}"
            )

    @property
    def lead(self) -> int:
        """Samples that the oldest measured regressor reaches back."""
        return max(self.na, self.dead_time + self.nb - 1)

    @property
    def coefficients(self) -> int:
        """All that are estimated, the intercept included."""
        return self.na + self.nb + self.nc + 1


@dataclass(frozen=True, slots=True)
class ArmaxFit:
    """An ARMAX model of a window.

    Attributes:
        orders: what was asked for.
        a, b, c: coefficients ``(a1, ...)``, ``(b1, ...)``, ``(c1, ...)`` in units of OP and PV.
        offset: intercept, in units of PV.
        innovation: one-step prediction errors, shape ``(n,)``; NaN in rows that were not used.
        rows: samples that were used.
        covariance: of ``(a, b, c, offset)``, shape ``(p, p)``.
        bic: ``rows log(mean square error) + p log(rows)``, to compare orders on the same rows.
        steps: Gauss-Newton steps taken; converged: whether they ended by themselves.
        period: seconds between samples.
    """

    orders: ArmaxOrders
    a: tuple[float, ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    offset: float
    innovation: Array
    rows: int
    covariance: Array
    bic: float
    steps: int
    converged: bool
    period: float

    @property
    def process(self) -> ProcessModel:
        """The process without its noise model."""
        return ProcessModel(self.a, self.b, self.orders.dead_time, self.offset, self.period)

    @property
    def variance(self) -> float:
        """Of the innovations, in units of PV squared."""
        return float(np.nanmean(np.square(self.innovation)))

    @property
    def gain_deviation(self) -> float:
        """Standard deviation of the steady-state gain (delta method); NaN when integrating."""
        process = self.process
        if process.is_integrating:
            return math.nan
        rest = 1.0 + math.fsum(self.a)
        na, nb = len(self.a), len(self.b)
        slope = np.zeros(self.orders.coefficients)
        slope[:na] = -process.gain / rest
        slope[na : na + nb] = 1.0 / rest
        return math.sqrt(max(0.0, float(slope @ self.covariance @ slope)))


@dataclass(frozen=True, slots=True)
class _Problem:
    """The window in scaled units; rows without complete, good regressors weigh nothing."""

    y: Array
    measured: Array
    weight: Array
    orders: ArmaxOrders

    def innovation(self, theta: Array) -> Array:
        """``e`` for ``theta = (a, b, offset, c)``, zero before the first used row."""
        linear = theta[: self.measured.shape[1]]
        noise = np.concatenate([[1.0], theta[self.measured.shape[1] :]])
        raw = self.weight * (self.y - self.measured @ linear)
        return np.asarray(scipy.signal.lfilter([1.0], noise, raw), dtype=np.float64)

    def slopes(self, theta: Array, error: Array) -> Array:
        """``-de/dtheta``: the regressors, past innovations among them, filtered by ``1 / C``."""
        noise = np.concatenate([[1.0], theta[self.measured.shape[1] :]])
        past = [_late(error, i) for i in range(1, self.orders.nc + 1)]
        phi = np.column_stack([self.measured * self.weight[:, None], *past])
        return np.asarray(scipy.signal.lfilter([1.0], noise, phi, axis=0), dtype=np.float64)

    def cost(self, error: Array) -> float:
        """Sum of squares over the used rows."""
        return float(np.square(error) @ self.weight)


def armax(
    stem: ArrayLike,
    pv: ArrayLike,
    orders: ArmaxOrders,
    *,
    good: ArrayLike | None = None,
    period: float = 1.0,
) -> ArmaxFit:
    """Fit an ARMAX model to PV for a known stem.

    Args:
        stem: stem position, shape ``(n,)``, units of OP, finite.
        pv: process variable, shape ``(n,)``, finite where ``good``.
        orders: of A, B and C, and the dead time.
        good: usable samples of PV, shape ``(n,)``, bool; all when left out. A row any of whose
            regressors is bad is not counted, and adds no innovation.
        period: seconds between samples.

    Raises:
        EstimatorError: shapes differ, a used number is not finite, the stem does not move, or
            fewer than five usable rows for each coefficient.
    """
    x, y = np.asarray(stem, dtype=np.float64), np.asarray(pv, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape:
        raise EstimatorError(
            f"stem and pv must be vectors of one length; got shapes {x.shape} and {y.shape}"
        )
    usable = np.isfinite(y) if good is None else np.asarray(good, dtype=np.bool_)
    if usable.shape != y.shape:
        raise EstimatorError(f"good has shape {usable.shape}, pv has {y.shape}: give one flag each")
    if not np.isfinite(x).all() or not np.isfinite(y[usable]).all() or not usable.any():
        raise EstimatorError(
            "stem and the good samples of pv must be finite: mark bad ones in good"
        )
    stem_scale, pv_scale = float(x.std()), float(y[usable].std())
    if stem_scale == 0.0 or pv_scale == 0.0:
        raise EstimatorError("the stem or pv does not move; give a window in which both move")
    stem_centre, pv_centre = float(x.mean()), float(y[usable].mean())
    scaled = np.where(usable, (np.where(usable, y, pv_centre) - pv_centre) / pv_scale, 0.0)
    problem = _problem((x - stem_centre) / stem_scale, scaled, usable, orders)
    rows = int(problem.weight.sum())
    if rows < 5 * orders.coefficients:
        raise EstimatorError(
            f"ARMAX has {orders.coefficients} coefficients and {rows} usable rows; "
            f"5 rows each are needed: record a longer window or lower the orders"
        )
    theta, error, steps, converged = _gauss_newton(problem, _hannan_rissanen(problem, usable))
    return _in_units(
        problem, theta, error, (stem_centre, stem_scale), (pv_centre, pv_scale),
        steps=steps, converged=converged, period=period,
    )  # fmt: skip


def _late(signal: Array, samples: int) -> Array:
    out = np.zeros_like(signal)
    out[samples:] = signal[: signal.size - samples]
    return out


def _problem(x: Array, y: Array, usable: Mask, orders: ArmaxOrders) -> _Problem:
    weight = usable.astype(np.float64)
    for i in range(1, orders.na + 1):
        weight[i:] *= usable[:-i]
    weight[: orders.lead] = 0.0
    columns = [-_late(y, i) for i in range(1, orders.na + 1)]
    columns += [_late(x, orders.dead_time + j) for j in range(orders.nb)]
    columns.append(np.ones(y.size))
    return _Problem(y, np.column_stack(columns), weight, orders)


def _hannan_rissanen(problem: _Problem, usable: Mask) -> Array:
    """A start for ``theta``, its C made invertible."""
    o = problem.orders
    linear = _least_squares(problem.measured, problem.y, problem.weight)
    if o.nc == 0:
        return linear
    x = problem.measured[:, o.na]
    # The stem's column is already late by the dead time.
    long = ArmaxOrders(_LONG * (o.na + o.nc), _LONG * o.nb, 0, 0)
    wide = _problem(x, problem.y, usable, long)
    if wide.weight.sum() < 3 * long.coefficients:
        return np.concatenate([linear, np.zeros(o.nc)])
    first = wide.weight * (
        problem.y - wide.measured @ _least_squares(wide.measured, problem.y, wide.weight)
    )
    weight = problem.weight * (np.arange(x.size) >= long.lead + o.nc)
    past = [_late(first, i) for i in range(1, o.nc + 1)]
    theta = _least_squares(np.column_stack([problem.measured, *past]), problem.y, weight)
    theta[-o.nc :] = _invertible(theta[-o.nc :])
    start = np.concatenate([linear, np.zeros(o.nc)])
    tried = [(problem.cost(problem.innovation(t)), i) for i, t in enumerate((theta, start))]
    return theta if min(tried)[1] == 0 else start


def _least_squares(columns: Array, target: Array, weight: Array) -> Array:
    found = np.linalg.lstsq(columns * weight[:, None], target * weight, rcond=1e-12)[0]
    return np.asarray(found, dtype=np.float64)


def _invertible(c: Array) -> Array:
    """C with the roots outside the circle of `_INVERTIBLE` mirrored or pulled into it."""
    roots = np.roots(np.concatenate([[1.0], c])).astype(np.complex128)
    size = np.abs(roots)
    roots = np.where(size > 1.0, roots / np.maximum(size, 1.0) ** 2, roots)
    size = np.abs(roots)
    roots = np.where(size > _INVERTIBLE, roots * (_INVERTIBLE / np.maximum(size, 1e-300)), roots)
    coefficients = np.zeros(c.size)
    found = np.real(np.poly(roots))[1:]
    coefficients[: found.size] = found
    return coefficients


def _is_invertible(c: Array) -> bool:
    if c.size == 0:
        return True
    return bool(np.abs(np.roots(np.concatenate([[1.0], c]))).max(initial=0.0) <= _INVERTIBLE + 1e-9)


def _gauss_newton(problem: _Problem, theta: Array) -> tuple[Array, Array, int, bool]:
    error = problem.innovation(theta)
    cost = problem.cost(error)
    noise = problem.measured.shape[1]
    for step in range(_STEPS):
        slopes = problem.slopes(theta, error)
        change = _least_squares(slopes, error, problem.weight)
        for halving in range(_HALVINGS):
            tried = theta + change * 0.5**halving
            if not _is_invertible(tried[noise:]):
                continue
            left = problem.innovation(tried)
            lower = problem.cost(left)
            if lower < cost:
                break
        else:
            return theta, error, step, True
        gained = (cost - lower) / cost
        theta, error, cost = tried, left, lower
        if gained < _CONVERGED:
            return theta, error, step + 1, True
    return theta, error, _STEPS, False


def _in_units(
    problem: _Problem,
    theta: Array,
    error: Array,
    stem: tuple[float, float],
    pv: tuple[float, float],
    *,
    steps: int,
    converged: bool,
    period: float,
) -> ArmaxFit:
    """The fit in units of OP and PV: ``theta`` is linear in them, and so is its covariance."""
    o = problem.orders
    rows = int(problem.weight.sum())
    slopes = problem.slopes(theta, error) * problem.weight[:, None]
    variance = problem.cost(error) / max(1, rows - theta.size)
    spread = variance * np.linalg.pinv(slopes.T @ slopes, rcond=1e-14, hermitian=True)
    # From (a, b, offset, c) scaled to (a, b, c, offset) in units: offset takes in both centres.
    ratio = pv[1] / stem[1]
    turn = np.zeros((theta.size, theta.size))
    index = np.arange(o.na)
    turn[index, index] = 1.0
    index = o.na + np.arange(o.nb)
    turn[index, index] = ratio
    index = o.na + o.nb + np.arange(o.nc)
    turn[index, index + 1] = 1.0
    turn[-1, : o.na] = pv[0]
    turn[-1, o.na : o.na + o.nb] = -ratio * stem[0]
    turn[-1, o.na + o.nb] = pv[1]
    found = turn @ theta
    found[-1] += pv[0]
    innovation = np.where(problem.weight > 0.0, error * pv[1], np.nan)
    mean = problem.cost(error) * pv[1] ** 2 / rows
    return ArmaxFit(
        orders=o,
        a=tuple(found[: o.na].tolist()),
        b=tuple(found[o.na : o.na + o.nb].tolist()),
        c=tuple(found[o.na + o.nb : -1].tolist()),
        offset=float(found[-1]),
        innovation=innovation,
        rows=rows,
        covariance=turn @ spread @ turn.T,
        bic=rows * math.log(mean) + theta.size * math.log(rows),
        steps=steps,
        converged=converged,
        period=float(period),
    )
