"""What the residuals say: how many independent samples they are worth, and how to whiten them."""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from estimator._kernels import Array, complete, lagged

__all__ = ["autoregression", "effective_samples", "errs_at_slips"]


def effective_samples(residual: Array, weight: Array) -> float:
    """Independent samples that ``residual`` (shape ``(n,)``) is worth where ``weight`` is 1.

    ``n / (1 + 2 sum rho_k^2)``: the sample size at which the mean square of independent residuals
    would be as uncertain as that of these (Bartlett's formula; Priestley, Spectral Analysis and
    Time Series, 1981, section 5.3). Squares make an oscillating residual count as little as a
    drifting one; ``1/n``, what chance adds to each square, is taken off.
    """
    count = float(weight.sum())
    x = residual[weight > 0.0]
    if count < 8 or not np.any(x):
        return max(1.0, count)
    x = x - x.mean()
    spectrum = np.abs(np.fft.rfft(x, 2 * x.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: x.size]
    if correlation[0] <= 0.0:
        return count
    squares = np.square(correlation[1 : max(2, x.size // 4)] / correlation[0])
    excess = float((squares - 1.0 / count).sum())
    return max(1.0, count / (1.0 + 2.0 * max(0.0, excess)))


def autoregression(residual: Array, weight: Array, max_order: int = 10) -> tuple[Array, float]:
    """Whitening filter ``(1, -a1, ..., -ar)`` of the residual and its innovation variance.

    The order minimises BIC; only rows whose past is complete are used.
    """
    max_order = max(1, min(max_order, int(weight.sum()) // 20))
    usable = complete(weight > 0.0, max_order)
    usable[:max_order] = False
    rows = lagged(residual, 0, max_order + 1, usable.astype(np.float64))
    # orders are nested: one Cholesky factor, the residual itself last, tells what each leaves
    gram = np.roll(rows @ rows.T, -1, axis=(0, 1))
    count = max(1, int(usable.sum()))
    gram.flat[:: max_order + 2] += 1e-13 * np.trace(gram) + 1e-300
    root = np.linalg.cholesky(gram)
    straight = root[-1, :-1]
    left = gram[-1, -1] - np.concatenate([[0.0], np.cumsum(np.square(straight))])
    variance = np.maximum(left / count, 1e-12 * left[0] / count)
    order = int(np.argmin(count * np.log(variance) + np.arange(max_order + 1) * np.log(count)))
    taps = np.linalg.solve(root[:order, :order].T, straight[:order])
    return np.concatenate([[1.0], -taps]), float(variance[order])


_AFTER = 3
_LEAST = 20
_SIGNIFICANT = 0.01


def errs_at_slips(residual: Array, weight: Array, stem: Array, dead_time: int) -> bool:
    """Whether one-step errors are larger after the stem's slips than elsewhere (F test, 1 %).

    All arrays have shape ``(n,)``. Noise knows nothing of slips: errors that follow them say that
    the slips, or the way the stem makes them, are not quite the real ones.
    """
    n = residual.size
    late = np.flatnonzero(np.diff(stem) != 0.0)[:, None] + 1 + dead_time + np.arange(_AFTER)
    after = np.zeros(n, dtype=np.bool_)
    after[late[late < n]] = True
    used = weight > 0.0
    near, far = residual[used & after], residual[used & ~after]
    if min(near.size, far.size) < _LEAST:
        return False
    spread = float(np.mean(far**2))
    ratio = float(np.mean(near**2)) / max(spread, 1e-300)
    return bool(fdtrc(near.size, far.size, ratio) < _SIGNIFICANT)
