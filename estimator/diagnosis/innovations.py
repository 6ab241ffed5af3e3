"""Compiled: the filter that whitens a load beside white noise, for `estimator.diagnosis.headroom`.

The spectrum of load plus noise is that of one white signal through one filter (Ljung 1999, section
2.3). In ``w = |1 - q^-1|^2`` a pole ``p`` has the spectrum ``(1 - p)^2 + p w``: a coefficient of
the sum is a sum of positive numbers, so slow loads, whose zeros crowd at 1, cost no digits. A
second load without a corner, a white one, adds the corner's factor of that sum.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled import kernel
from estimator.arrays import Array

__all__ = ["poles_product", "power_of_load", "whitening_numerator"]

Complex = NDArray[np.complex128]

_DIED = 1e-17
"""Share of a sum that is lost in it: a tenth of what changes the last digit of a double."""
_HALVINGS = 64
"""Halvings of a bracket: as many as a double has digits, and some."""


@kernel
def power_of_load(poles: Array) -> float:
    """Sum of squares of the first 2,000 samples of a load's answer to one pulse.

    Args:
        poles: the load's denominator, ``(m + 1,)``, 1 first, of one to three poles from 0 to 1. An
            integrator's answer does not end; others end where they no longer change the sum.
    """
    a1 = poles[1]
    a2 = poles[2] if poles.size > 2 else 0.0
    a3 = poles[3] if poles.size > 3 else 0.0
    x1 = x2 = x3 = total = 0.0
    now = 1.0
    for _ in range(2000):
        total += now * now
        # poles from 0 to 1: the answer has one peak, and behind it only falls
        if now * now < _DIED * total:
            break
        x1, x2, x3 = now, x1, x2
        now = -a1 * x1 - a2 * x2 - a3 * x3
    return total


@kernel
def poles_product(poles: Array) -> Array:
    """The polynomial in ``q^-1``, ``(m + 1,)``, 1 first, with these real poles ``(m,)``."""
    product = np.zeros(poles.size + 1)
    product[0] = 1.0
    for m in range(poles.size):
        for i in range(m + 1, 0, -1):
            product[i] -= poles[m] * product[i - 1]
    return product


@kernel
def whitening_numerator(poles: Array, noise: float, white: float) -> Array:
    """The numerator ``(m + 1,)``, 1 first, whose spectrum over the load's is load plus noise.

    Args:
        poles: of the load, 0 to 1, ``(m,)``, three at most; its own corner first, then those of
            the process that it passes.
        noise: variance of the noise over the load's; above zero.
        white: variance of a second load without a corner, behind the same process, over that of
            the first; 0 for none.
    """
    spectrum = np.zeros(poles.size + 1)
    spectrum[0] = noise
    for m in range(poles.size):
        for i in range(m + 1, -1, -1):
            spectrum[i] *= (1.0 - poles[m]) ** 2
            if i > 0:
                spectrum[i] += poles[m] * spectrum[i - 1]
    spectrum[0] += 1.0 / power_of_load(poles_product(poles))
    if white > 0.0:
        level = white / power_of_load(poles_product(poles[1:]))
        spectrum[0] += level * (1.0 - poles[0]) ** 2
        spectrum[1] += level * poles[0]
    product = np.zeros(poles.size + 1, dtype=np.complex128)
    product[0] = 1.0
    for w in _roots(spectrum):
        # q^2 - (2 - w) q + 1 = 0 in 1 - q, of which the one inside the unit circle
        half = 0.5 * np.sqrt(w * (w - 4.0))
        zero = 1.0 - (0.5 * w + half)
        if abs(zero) > 1.0:
            zero = 1.0 - (0.5 * w - half)
        for i in range(product.size - 1, 0, -1):
            product[i] -= zero * product[i - 1]
    return product.real.copy()


@kernel
def _roots(c: Array) -> Complex:
    """Roots of ``c_0 + c_1 w + ...``, of degree three at most, all coefficients above zero."""
    degree = c.size - 1
    found = np.empty(degree, dtype=np.complex128)
    if degree == 1:
        found[0] = -c[0] / c[1]
    elif degree == 2:
        found[0], found[1] = _pair(c[0], c[1], c[2])
    elif degree == 3:
        x = _size_of_real_root(c)
        # the middle coefficient of what is left, from the end that rounds less
        ahead, behind = c[2] - x * c[3], (c[1] - c[0] / x) / x
        middle = ahead if max(c[2], x * c[3]) < max(c[1], c[0] / x) / x else behind
        found[0] = -x
        found[1], found[2] = _pair(c[0] / x, middle, c[3])
    return found


@kernel
def _size_of_real_root(c: Array) -> float:
    """The ``x`` of a root ``-x`` of a cubic whose coefficients are above zero."""
    # Fujiwara's bounds of the largest and of the smallest root
    high = 2.0 * max(c[2] / c[3], math.sqrt(c[1] / c[3]), (c[0] / c[3]) ** (1.0 / 3.0))
    low = 0.5 / max(c[1] / c[0], math.sqrt(c[2] / c[0]), (c[3] / c[0]) ** (1.0 / 3.0))
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        if c[0] + middle * (-c[1] + middle * (c[2] - middle * c[3])) > 0.0:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


@kernel
def _pair(c0: float, c1: float, c2: float) -> tuple[complex, complex]:
    """Both roots of ``c0 + c1 w + c2 w^2``."""
    root = np.sqrt(complex(c1 * c1 - 4.0 * c0 * c2))
    far = -0.5 * (c1 + root) if c1 > 0.0 else -0.5 * (c1 - root)
    return far / c2, c0 / far
