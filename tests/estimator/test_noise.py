"""The noise model: what it leaves of noise whose innovations are known."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from estimator.hypotheses.noise import fit_noise
from estimator.rows import rows_of
from estimator.settings import SETTINGS
from estimator.window import harmonise


def test_a_load_that_wanders_through_a_lag_leaves_little_more_than_its_innovations() -> None:
    n, excess = 1000, []
    op = np.sin(np.arange(n) / 9.0)
    for seed in range(20):
        innovations = np.random.default_rng(seed).standard_normal(n)
        lagged = np.zeros(n)
        for k in range(1, n):
            lagged[k] = 0.8 * lagged[k - 1] + innovations[k]
        wandering = np.cumsum(lagged)
        window = harmonise(op, wandering, None, None, 1.0, SETTINGS.screening)
        rows = rows_of(window, 0.0, SETTINGS.modelling)
        taps = fit_noise(rows, wandering, SETTINGS.modelling)
        left = np.mean(lfilter([1.0, *-taps], [1.0], wandering)[rows.first :] ** 2)
        excess.append(left / np.mean(innovations[rows.first :] ** 2))
    assert np.median(excess) < 1.1
    assert max(excess) < 1.5
