"""What the residuals say: how many independent samples they are worth, and how to whiten them."""

from __future__ import annotations

import numpy as np

from estimator._kernels import Array

__all__ = ["autoregression", "effective_samples"]


def effective_samples(residual: Array, weight: Array) -> float:
    """Independent samples that ``residual`` (shape ``(n,)``) is worth where ``weight`` is 1.

    ``n / (1 + 2 sum rho_k)``, the autocorrelations summed up to the first that is insignificant
    (the initial positive sequence).
    """
    count = float(weight.sum())
    x = residual[weight > 0.0]
    if count < 8 or not np.any(x):
        return count
    x = x - x.mean()
    spectrum = np.abs(np.fft.rfft(x, 2 * x.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: x.size]
    if correlation[0] <= 0.0:
        return count
    correlation = correlation / correlation[0]
    small = np.flatnonzero(correlation < 2.0 / np.sqrt(count))
    last = int(small[0]) if small.size else x.size
    return float(max(1.0, count / (1.0 + 2.0 * correlation[1:last].sum())))


def autoregression(residual: Array, weight: Array, max_order: int = 10) -> tuple[Array, float]:
    """Whitening filter ``(1, -a1, ..., -ar)`` of the residual and its innovation variance.

    The order minimises BIC; only rows whose past is complete are used.
    """
    n = residual.size
    max_order = max(1, min(max_order, int(weight.sum()) // 20))
    past = np.stack([residual[max_order - i - 1 : n - i - 1] for i in range(max_order)], axis=1)
    usable = weight[max_order:] > 0.0
    for i in range(max_order):
        usable &= weight[max_order - i - 1 : n - i - 1] > 0.0
    past, now = past[usable], residual[max_order:][usable]
    count = max(1, now.size)
    best = (np.inf, np.ones(1), 1.0)
    for order in range(max_order + 1):
        taps, *_ = np.linalg.lstsq(past[:, :order], now, rcond=None)
        variance = max(float(np.mean((now - past[:, :order] @ taps) ** 2)), 1e-300)
        bic = count * np.log(variance) + order * np.log(count)
        if bic < best[0]:
            best = (bic, np.concatenate([[1.0], -taps]), variance)
    return best[1], best[2]
