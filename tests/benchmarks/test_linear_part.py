"""The comparison of ARX with ARMAX picks orders by BIC."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.linear_part import order_choice
from loop_model import ProcessModel


def test_orders_follow_the_process_and_its_noise():
    rng = np.random.default_rng(1)
    stem = 50.0 + np.repeat(rng.normal(0.0, 4.0, 100), 10)
    process = ProcessModel((-0.8,), (0.2,), 1, 0.0, 1.0)
    equation = order_choice(
        stem, process.simulate(stem, noise=rng.normal(0, 0.1, 1000)), noise=False
    )
    assert (equation.orders.na, equation.orders.nb) == (1, 1)
    on_pv = process.simulate(stem) + rng.normal(0.0, 0.5, 1000)
    assert order_choice(stem, on_pv, noise=True).process.gain == pytest.approx(1.0, abs=0.05)
    # ARX needs more coefficients to imitate the noise on PV.
    assert order_choice(stem, on_pv, noise=False).orders.na > 1
