"""A closed loop to make windows from: PI controller, sticky valve, process with dead time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.evidence.sign import controller_action
from estimator.hypotheses.hypothesis import Case
from estimator.rows import rows_of
from estimator.settings import SETTINGS
from estimator.window import harmonise
from loop_model import ValveModel

Array = NDArray[np.float64]
Loop = Callable[..., tuple[Array, Array, Array]]


def closed_loop(
    valve: ValveModel | None,
    *,
    samples: int = 1000,
    time_constant: float = 6.0,
    dead_time: int = 2,
    integrating: bool = False,
    noise: float = 0.05,
    drift: float = 0.0,
    sine: float = 0.0,
    triangle: float = 0.0,
    curve: float = 0.0,
    seed: int = 0,
    aggressive: float = 1.0,
    setpoints: tuple[float, ...] = (7.0,),
) -> tuple[Array, Array, Array]:
    """OP, PV and stem of a loop after 600 samples of settling (gain 1, SIMC tuning).

    Outside oscillations have a period of 60 samples. A ``curve`` bends the installed
    characteristic: the flow is ``x + curve (x - 7)^2``, 7 being the set-point.
    """
    rng = np.random.default_rng(seed)
    total = samples + 600
    pole = np.exp(-1.0 / time_constant)
    closed = max(float(dead_time), 0.5 * time_constant)
    slope = 0.05 if integrating else 1.0 / time_constant
    gain = aggressive / (slope * (closed + dead_time))
    integral = 4.0 * (closed + dead_time)
    if not integrating:
        integral = min(time_constant, integral)
    op, pv, stem = np.empty(total), np.empty(total), np.empty(total)
    u = x = y = walk = 0.0
    error = 0.0
    moved = [0.0] * (dead_time + 1)
    for k in range(total):
        target = setpoints[k * len(setpoints) // total]
        walk = 0.999 * walk + drift * rng.standard_normal()
        outside = sine * np.sin(2.0 * np.pi * k / 60.0)
        outside += triangle * (2.0 * abs(2.0 * (k / 60.0 % 1.0) - 1.0) - 1.0)
        pv[k] = y + walk + outside + noise * rng.standard_normal()
        last, error = error, target - pv[k]
        u += gain * ((error - last) + error / integral)
        op[k] = u
        x = u if valve is None else valve.step(x, u)
        stem[k] = x
        moved = [x, *moved[:-1]]
        delayed = moved[dead_time - 1]
        delayed += curve * (delayed - 7.0) ** 2
        y = y + 0.05 * delayed if integrating else pole * y + (1.0 - pole) * delayed
    return op[600:] + 40.0, pv[600:], stem[600:] + 40.0


@pytest.fixture(scope="session")
def loop() -> Loop:
    """`closed_loop` as a fixture."""
    return closed_loop


@pytest.fixture(scope="session")
def sticky_window() -> tuple[Array, Array, Array]:
    """OP, PV and stem of a loop with S = 5 and J = 2."""
    return closed_loop(ValveModel(5.0, 2.0), samples=500, noise=0.05, seed=3)


def case_of(op: Array, pv: Array, *, signed: bool = True) -> Case:
    """The rows of a window as `identify` prepares them; ``signed`` is whether the sign is told."""
    action = controller_action(op, pv, None) if signed else 0.0
    sign = math.copysign(1.0, action) if abs(action) > SETTINGS.modelling.action_t else 0.0
    window = harmonise(op, pv, None, None, 1.0, SETTINGS.screening)
    return Case(rows_of(window, sign, SETTINGS.modelling), SETTINGS)


@pytest.fixture(scope="session")
def case() -> Callable[..., Case]:
    """`case_of` as a fixture."""
    return case_of
