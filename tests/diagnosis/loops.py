"""A simulated loop for tests: PI(D) in velocity form, a lag with dead time, He's valve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loop_model import ValveModel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Loop:
    """OP, PV and SP of a run."""

    op: Floats
    pv: Floats
    sp: Floats


def run(
    *,
    gain: float = 0.8,
    integral_time: float = 12.0,
    derivative_time: float = 0.0,
    process_gain: float = 1.5,
    lag: float = 12.0,
    dead: int = 3,
    band: float = 0.0,
    jump: float = 0.0,
    load: Floats | None = None,
    noise: float = 0.02,
    sp: Floats | None = None,
    limits: tuple[float, float] = (0.0, 100.0),
    n: int = 1500,
    seed: int = 1,
) -> Loop:
    """Simulate; ``load`` is in units of OP at the process's entry."""
    rng = np.random.default_rng(seed)
    warm = 300
    push = np.concatenate([np.zeros(warm), np.zeros(n) if load is None else load])
    target = np.concatenate([np.zeros(warm), np.zeros(n) if sp is None else sp])
    valve = ValveModel(band, jump)
    op = np.full(n + warm, 50.0)
    pv = np.zeros(n + warm)
    stem, y, u = 50.0, 0.0, 50.0
    delayed = [50.0] * dead
    pole = np.exp(-1.0 / lag)
    last = older = last_e = 0.0
    walk = 0.0
    for k in range(n + warm):
        pv[k] = y + noise * rng.standard_normal()
        e = target[k] - pv[k]
        u += gain * (e - last_e + e / integral_time)
        u -= gain * derivative_time * (pv[k] - 2.0 * last + older)
        u = min(max(u, limits[0]), limits[1])
        last_e, older, last = e, last, pv[k]
        op[k] = u
        stem = valve.step(stem, u) if band > 0.0 else u
        delayed.append(stem)
        walk = 0.97 * walk + 0.15 * rng.standard_normal()
        y = pole * y + (1.0 - pole) * process_gain * (delayed.pop(0) - 50.0 + push[k] + walk)
    keep = slice(warm, None)
    return Loop(op[keep], 50.0 + pv[keep], 50.0 + target[keep])
