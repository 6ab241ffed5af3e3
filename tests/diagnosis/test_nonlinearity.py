"""The bicoherence: near 1 for a limit cycle, low for a linear loop with noise."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter, sawtooth

from estimator.diagnosis.nonlinearity import largest_bicoherence

PERIOD = 30.0


def test_a_limit_cycle_is_told_from_a_linear_resonance() -> None:
    rng = np.random.default_rng(2)
    slips = sawtooth(2.0 * np.pi * np.arange(1500) / PERIOD)
    cycle = lfilter([0.2], [1.0, -0.8], slips) + 0.1 * rng.standard_normal(1500)
    assert largest_bicoherence(cycle, PERIOD) > 0.8
    pole = 0.98
    poles = [1.0, -2.0 * pole * np.cos(2.0 * np.pi / PERIOD), pole**2]
    linear = [lfilter([1.0], poles, rng.standard_normal(1500)) for _ in range(8)]
    assert max(largest_bicoherence(one, PERIOD) for one in linear) < 0.8


def test_a_record_of_few_periods_has_none() -> None:
    assert np.isnan(largest_bicoherence(np.sin(np.arange(100) / 5.0), PERIOD))
