"""Compiled tables of one process: what least squares needs of a step at any sample.

The response of two lags to a step is a sum of three modes: a constant (or, for an integrator, a
ramp besides) and two exponentials. Between slips the response of a stem is such a sum as well, so
its energy over all later samples, weights and noise filter included, is a product of the modes with
a table made once per process; and its products with PV and with the columns that all candidates
share are sums of table entries at the slips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, add, filtered, kernel

__all__ = [
    "Basis",
    "Simulated",
    "least_squares",
    "ordered_poles",
    "orthonormal",
    "shared_rows",
    "simulated_tables",
]

_APART = 1e-3
_LEAST = 0.02
_STARTS_SLOWLY = 0.3
"""From this pole on, what is left of the state before the window is a column of its own."""


class Basis(NamedTuple):
    """What does not depend on the process: PV and the shared columns of a window.

    ``target`` is PV, whitened and weighted, ``(n,)``; ``level`` and ``slope`` hold orthonormal
    shared columns without and with the straight line of an integrator, ``(k, n)``; ``weight`` is
    ``(n,)``; ``taps`` the noise filter, ``(1,)`` for none.
    """

    target: Array
    level: Array
    slope: Array
    weight: Array
    taps: Array


class Simulated(NamedTuple):
    """Tables of one process, a row for each sample at which a step may be, ``n + pad`` of them.

    ``shared``, ``((n + pad) * rows,)``, sample by sample: PV's unexplained part and the orthonormal
    shared columns, each summed against the response to the step. ``own``, ``(4, n + pad)``: the
    energy of each mode and of the step response itself against that response. ``close`` corrects
    the energy for slips nearer to each other than the noise filter is long. ``decay`` holds the
    powers of both poles.
    """

    shared: Array
    rows: int
    own: Array
    close: Array
    decay: Array
    integrating: bool
    modes: Array
    energy: float


@kernel
def ordered_poles(slow: float, fast: float) -> tuple[float, float]:
    """Poles that the formulas can bear: slower first, and not equal."""
    # a lag of a quarter of a sample is none, and its powers would leave the number range
    slow, fast = (slow if slow > _LEAST else 0.0), (fast if fast > _LEAST else 0.0)
    if slow == 0.0:
        fast = 0.0
    elif slow < 1.0 and slow - fast < _APART * (1.0 - slow):
        fast = slow - _APART * (1.0 - slow)
    return slow, fast


@kernel
def simulated_tables(basis: Basis, slow: float, fast: float, pad: int) -> Simulated:
    """Tables for a process of poles ``slow >= fast`` (0 is no lag, ``slow = 1`` an integrator)."""
    n, order = basis.target.size, basis.taps.size
    integrating = slow >= 1.0
    slow, fast = ordered_poles(slow, fast)
    rows = shared_rows(basis, fast if integrating else slow, integrating)
    modes, response = _step_response(basis.taps, slow, fast, integrating, n)
    shared = _against_steps(rows, basis.taps, slow, fast, integrating, pad)
    own, close = np.zeros((4, n + pad)), np.zeros((order, n + pad))
    second = 0.0 if integrating else slow
    if order == 1:
        _energies(basis.weight, modes, second, fast, integrating, own)
    else:
        _filtered_energies(
            basis.weight, modes, response, order, second, fast, integrating, own, close
        )
    decay = np.ones((2, n + 1))
    for k in range(1, n + 1):
        decay[0, k] = decay[0, k - 1] * slow
        decay[1, k] = decay[1, k - 1] * fast
    energy = 0.0
    for k in range(n):
        energy += rows[0, k] * rows[0, k]
    return Simulated(shared, rows.shape[0], own, close, decay, integrating, modes, energy)


@kernel
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@kernel
def _straighten(rows: Array, number: int, first: int) -> None:
    """Make a row orthonormal to those from ``first`` on before it; zero where they span it."""
    row = rows[number]
    before = _dot(row, row)
    for _ in range(2):
        for r in range(first, number):
            add(row, -_dot(row, rows[r]), rows[r])
    size = _dot(row, row)
    if size > 1e-12 * before and size > 0.0:
        row /= np.sqrt(size)
    else:
        row[:] = 0.0


@kernel
def orthonormal(rows: Array) -> Array:
    """The rows ``(k, n)`` made orthonormal, in place (Gram and Schmidt, twice)."""
    for number in range(rows.shape[0]):
        _straighten(rows, number, 0)
    return rows


@kernel
def least_squares(rows: Array, target: Array) -> tuple[Array, Array]:
    """Shares ``(k,)`` of the rows ``(k, n)`` in ``target``, and what is left of it, ``(n,)``.

    A row that those before it span has no share.
    """
    basis = orthonormal(rows.copy())
    count = rows.shape[0]
    shares, left = np.zeros(count), target.copy()
    for r in range(count):
        shares[r] = _dot(basis[r], target)
        add(left, -shares[r], basis[r])
    for r in range(count - 1, -1, -1):
        own = _dot(basis[r], rows[r])
        for later in range(r + 1, count):
            shares[r] -= shares[later] * _dot(basis[r], rows[later])
        shares[r] = shares[r] / own if own > 0.0 else 0.0
    return shares, left


@kernel
def shared_rows(basis: Basis, pole: float, integrating: bool) -> Array:
    """PV's unexplained part above the orthonormal shared columns.

    What is left of the state before the window decays with the slowest pole, ``pole``.
    """
    shared = basis.slope if integrating else basis.level
    n, count = basis.target.size, shared.shape[0]
    starts = pole > _STARTS_SLOWLY
    rows = np.empty((count + 1 + (1 if starts else 0), n))
    rows[0] = basis.target
    rows[1 : count + 1] = shared
    if starts:
        power = 1.0
        raw = np.empty(n)
        for k in range(n):
            raw[k] = power
            power *= pole
        rows[count + 1] = filtered(raw, basis.taps, 1.0) * basis.weight
        _straighten(rows, count + 1, 1)
    for r in range(1, rows.shape[0]):
        add(rows[0], -_dot(rows[0], rows[r]), rows[r])
    return rows


@kernel
def _step_response(
    taps: Array, slow: float, fast: float, integrating: bool, n: int
) -> tuple[Array, Array]:
    """Coefficients of the modes (constant, slow, fast) and the response itself while it differs."""
    modes = np.zeros(3)
    if integrating:
        modes[0] = (1.0 - fast / (1.0 - fast)) / n
        modes[1] = 1.0 / n
        modes[2] = fast * fast / (1.0 - fast) / n
    else:
        modes[0] = 1.0
        if slow > 0.0:
            modes[1] = -(1.0 - fast) * slow * slow / (slow - fast)
        if fast > 0.0:
            modes[2] = (1.0 - slow) * fast * fast / (slow - fast)
    order = taps.size
    plain = np.empty(order)
    for m in range(order):
        ramp = float(m) if integrating else slow**m
        plain[m] = modes[0] + modes[1] * ramp + modes[2] * fast**m
    response = np.zeros(order)
    for m in range(order):
        for i in range(m + 1):
            response[m] += taps[i] * plain[m - i]
    filtered = np.zeros(3)
    for i in range(order):
        filtered[0] += taps[i] * (modes[0] - (modes[1] * i if integrating else 0.0))
        if integrating:
            filtered[1] += taps[i] * modes[1]
        elif slow > 0.0:
            filtered[1] += taps[i] * modes[1] * slow ** (-i)
        if fast > 0.0:
            filtered[2] += taps[i] * modes[2] * fast ** (-i)
    return filtered, response


@kernel
def _against_steps(
    rows: Array, taps: Array, slow: float, fast: float, integrating: bool, pad: int
) -> Array:
    """For every sample, each row against the response to a step there (backward in time)."""
    count, n = rows.shape
    table = np.zeros((n + pad) * count)
    one, two, total = np.zeros(count), np.zeros(count), np.zeros(count)
    keep = 1.0 if integrating else slow
    take = 1.0 / n if integrating else 1.0 - slow
    if taps.size > 1:
        plain, rows = rows, np.empty((count, n))
        for r in range(count):
            rows[r] = filtered(plain[r, ::-1].copy(), taps, 0.0)[::-1]
    for k in range(n - 1, -1, -1):
        for r in range(count):
            one[r] = keep * one[r] + take * rows[r, k]
            two[r] = fast * two[r] + (1.0 - fast) * one[r]
            total[r] += two[r]
            table[k * count + r] = total[r]
    return table


@kernel
def _energies(
    weight: Array, modes: Array, slow: float, fast: float, integrating: bool, own: Array
) -> None:
    """Energy of each mode, and of the step response, against the response to a step there."""
    m0, m1, m2 = modes
    n00 = n01 = n02 = n11 = n12 = n22 = 0.0
    slow2, both, fast2 = slow * slow, slow * fast, fast * fast
    for k in range(weight.size - 1, -1, -1):
        w = weight[k]
        if integrating:
            # the ramp is zero at the step itself and one later a sample on
            n11 = n11 + 2.0 * n01 + n00
            n12 = fast * (n12 + n02)
            n01 = n01 + n00
        else:
            n11 = w + slow2 * n11
            n12 = w + both * n12
            n01 = w + slow * n01
        n00 = w + n00
        n02 = w + fast * n02
        n22 = w + fast2 * n22
        e0 = m0 * n00 + m1 * n01 + m2 * n02
        e1 = m0 * n01 + m1 * n11 + m2 * n12
        e2 = m0 * n02 + m1 * n12 + m2 * n22
        own[0, k], own[1, k], own[2, k] = e0, e1, e2
        own[3, k] = m0 * e0 + m1 * e1 + m2 * e2


@kernel
def _filtered_energies(
    weight: Array,
    modes: Array,
    response: Array,
    order: int,
    slow: float,
    fast: float,
    integrating: bool,
    own: Array,
    close: Array,
) -> None:
    """The same with a noise filter, which the modes hold from its length on after a step only."""
    n = weight.size
    _energies(weight, modes, slow, fast, integrating, own)
    second, third = np.empty(order), np.empty(order)
    for m in range(order):
        second[m] = float(m) if integrating else slow**m
        third[m] = fast**m
    excess = response - modes[0] - modes[1] * second - modes[2] * third
    products = np.empty((order, order))
    for gap in range(order):
        for m in range(order - gap):
            products[gap, m] = excess[m + gap] * response[m]
    # where no sample is masked within the filter's length, all steps have the same part
    whole = np.empty(order)
    for gap in range(order):
        whole[gap] = products[gap, : order - gap].sum()
    whole0, whole1, whole2 = excess.sum(), (excess * second).sum(), (excess * third).sum()
    for gap in range(order):
        close[gap, :n] = whole[gap]
    run = 0
    for k in range(n - 1, -1, -1):
        run = run + 1 if weight[k] == 1.0 else 0
        e0, e1, e2 = whole0, whole1, whole2
        if run < order:
            e0 = e1 = e2 = 0.0
            for m in range(min(order, n - k)):
                part = weight[k + m] * excess[m]
                e0 += part
                e1 += part * second[m]
                e2 += part * third[m]
            for gap in range(order):
                total = 0.0
                for m in range(min(order - gap, n - k)):
                    total += weight[k + m] * products[gap, m]
                close[gap, k] = total
        own[0, k] += e0
        own[1, k] += e1
        own[2, k] += e2
        own[3, k] += modes[0] * e0 + modes[1] * e1 + modes[2] * e2 + close[0, k]
