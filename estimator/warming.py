"""Load or compile the kernels ahead of the first window."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from estimator.identify import identify
from loop_model import ValveModel

__all__ = ["rehearsal_windows", "warm_up"]

_SAMPLES = 400
"""Of a window: a dozen strokes, ten turns of the wave."""


def warm_up() -> None:
    """Load or compile the kernels of a verdict, so that the first window does not wait for them."""
    for op, pv in rehearsal_windows():
        identify(op, pv)


def rehearsal_windows() -> tuple[tuple[Array, Array], ...]:
    """Return OP and PV of simulated loops whose verdicts between them need nearly every kernel.

    A sticky valve, a healthy one under a wave, one under a saw-tooth that comes unevenly, and
    sticky ones whose set-point (which is not given) or whose load steps.
    """
    sticky = ValveModel(6.0, 3.0)
    k = np.arange(_SAMPLES)
    wave = 3.0 * np.abs(k / 37.0 % 2.0 - 1.0)
    steps = np.zeros(_SAMPLES)
    for at, size in ((60, 4.0), (130, -6.0), (190, 3.0), (260, 5.0), (330, -4.0)):
        steps[at:] += size
    return (
        _run(sticky, np.full(_SAMPLES, 4.0)),
        _run(ValveModel(0.0, 0.0), wave),
        _run(ValveModel(0.0, 0.0), _uneven_saw_tooth()),
        _run(sticky, np.full(_SAMPLES, 4.0), steps),
        _run(sticky, 2.0 * steps),
    )


def _uneven_saw_tooth() -> Array:
    """Lengths and heights differ by a tenth from cycle to cycle."""
    rng = np.random.default_rng(1)
    lengths = np.tile((4.0, 36.0), 10) * rng.normal(1.0, 0.1, 20)
    heights = np.tile((-3.0, 3.0), 10) * rng.normal(1.0, 0.1, 20)
    return np.interp(np.arange(_SAMPLES), np.cumsum(lengths) - 40.0, heights)


def _run(valve: ValveModel, load: Array, sp: Array | float = 0.0) -> tuple[Array, Array]:
    """A lag under a PI controller, from rest."""
    gain, pole, proportional, integral = 2.0, 0.85, 0.6, 0.075
    noise = np.random.default_rng(1).normal(0.0, 0.05, load.size)
    op, pv = np.zeros(load.size), np.zeros(load.size)
    target = np.broadcast_to(sp, load.shape)
    stem, lagged, total = 0.0, 0.0, 0.0
    for k in range(load.size):
        lagged = pole * lagged + (1.0 - pole) * gain * stem
        pv[k] = lagged + load[k] + noise[k]
        error = target[k] - pv[k]
        total += integral * error
        op[k] = total + proportional * error
        stem = valve.step(stem, op[k])
    return op, pv
