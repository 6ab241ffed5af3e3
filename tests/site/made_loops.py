"""Simulated loops that use no model of ours: PI, He's valve, first order, dead time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def made_loop(seed: int, samples: int = 500) -> tuple[Floats, Floats]:
    """OP (rounded to 0.01 %) and noisy PV of a loop in automatic with two set-point steps."""
    draws = np.random.default_rng(seed)
    S = float(draws.choice([0.0, 3.0, 6.0]))
    tau, dead = draws.uniform(3.0, 20.0), int(draws.integers(1, 6))
    sign, gain, Ti = draws.choice([-1.0, 1.0]), draws.uniform(0.3, 0.8), draws.uniform(5.0, 15.0)
    sp = x = 60.0
    integral = stem = 50.0
    on_its_way = [50.0] * dead
    ops, pvs = [], []
    for k in range(samples):
        if k in (samples // 5, samples // 2):
            sp += 3.0
        pv = x + 0.1 * draws.normal()
        error = sign * (sp - pv)
        integral += gain / Ti * error
        op = round(float(np.clip(integral + gain * error, 0.0, 100.0)), 2)
        if abs(op - stem) > S / 2.0:
            stem = op - np.sign(op - stem) * S / 3.0
        on_its_way.append(stem)
        x += (60.0 + sign * 1.2 * (on_its_way.pop(0) - 50.0) - x) / tau
        ops.append(op)
        pvs.append(pv)
    return np.array(ops), np.array(pvs)
