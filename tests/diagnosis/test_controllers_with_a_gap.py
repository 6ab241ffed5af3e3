"""A controller that leaves small errors as they are: its loop is not the linear one."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.diagnosis import Diagnosis, diagnose


def with_gap(seed: int) -> Diagnosis:
    """A lag of 22 scans under PI with a gap of 0.8, and a load that wanders."""
    rng = np.random.default_rng(seed)
    n, warm, late = 1800, 600, [0.0] * 4
    op, pv = np.empty(n + warm), np.empty(n + warm)
    y = u = load = last = summed = 0.0
    for k in range(n + warm):
        pv[k] = y + 0.05 * rng.standard_normal()
        if abs(pv[k]) >= 0.8:
            summed -= 3.4 * pv[k] / 22.0
            u = summed - 3.4 * pv[k]
        op[k] = u
        late.append(u)
        load = 0.983 * load + 0.55 * rng.standard_normal()
        y += (0.77 * (late.pop(0) + load) - y) / 22.0
        last = pv[k]
    assert np.isfinite(last)
    return diagnose(50.0 + op[warm:], 50.0 + pv[warm:], np.full(n, 50.0), period=1.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_its_tuning_is_not_called_tight_and_nothing_is_proposed(seed: int) -> None:
    answer = with_gap(seed)
    assert "tight_tuning" not in {cause.name for cause in answer.causes}
    assert answer.tuning is None
