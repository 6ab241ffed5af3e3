"""A window of a sticky loop with known parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from loop_model import ProcessModel, ValveModel


@dataclass(frozen=True)
class KnownLoop:
    op: NDArray[np.float64]
    pv: NDArray[np.float64]
    valve: ValveModel
    process: ProcessModel


def closed_loop(
    *,
    samples: int = 400,
    noise: float = 0.02,
    seed: int = 1,
    valve: ValveModel | None = None,
    gain: float = 1.5,
    reset: float = 0.4,
) -> KnownLoop:
    """A PI loop on a second-order process, already oscillating when the window starts."""
    valve = valve or ValveModel.from_friction(3.0, 1.5)
    process = ProcessModel(a=(-1.5, 0.56), b=(0.04, 0.02), dead_time=1, offset=0.0, period=1.0)
    rng = np.random.default_rng(seed)
    skip = 200
    total = samples + skip
    op, pv = np.zeros(total), np.zeros(total)
    stem, x = 0.0, np.zeros(total)
    integral = 0.0
    for k in range(total):
        if k >= 2:
            pv[k] = 1.5 * pv[k - 1] - 0.56 * pv[k - 2] + 0.04 * x[k - 1] + 0.02 * x[k - 2]
            pv[k] += rng.normal(0.0, noise)
        error = 5.0 - pv[k]
        integral += reset * error
        op[k] = gain * error + integral
        stem = valve.step(stem, op[k])
        x[k] = stem
    return KnownLoop(op[skip:], pv[skip:], valve, process)


@pytest.fixture(scope="session")
def sticky_loop() -> KnownLoop:
    return closed_loop()
