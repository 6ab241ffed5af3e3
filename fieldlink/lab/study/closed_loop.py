"""Closed-loop studies: a plant with a sticky valve, any controller, and the figures to judge by.

A plain simulation on `loop_model`'s equations, deterministic for a seed, that tests, benchmarks and
the command line share. One scan: PV is read, the controller observes it and decides, OP is applied,
the plant moves on by one period.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compensator.action import ActionStatus, CompensatorError, Controller
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = [
    "EXAMPLE_1",
    "EXAMPLE_2",
    "Performance",
    "Plant",
    "SteppedPlant",
    "Study",
    "Trace",
    "assess",
    "drive",
    "held_stem_std",
    "run",
]

Array = NDArray[np.float64]
StemLaw = Callable[[float, float], float]

EXAMPLE_1 = LoopModel(
    ValveModel.from_friction(7.0, 4.0),
    ProcessModel((-2.232, 1.645, -0.3998), (0.00277, 0.00884, 0.001752), 1, 0.0, 1.0),
)
"""Example 1 of Bacci di Capaci et al. (2018), (14)-(15); its equation noise has a deviation of
0.01. The printed coefficients are (14) sampled exactly and rounded (gain 1.012 for 1)."""

EXAMPLE_2 = LoopModel(
    ValveModel.from_friction(5.0, 2.0),
    ProcessModel((-2.091, 1.375, -0.2725), (0.002445, 0.007181, 0.001278), 1, 0.0, 1.0),
)
"""Example 2, (18); its equation noise has a deviation of 10**-1.5. The printed
coefficients are those of 1/((10s+1)(5s+1)(s+1)) rounded, which makes a gain of 0.948 of 1."""


@dataclass(frozen=True, slots=True)
class Study:
    """What a plant is put through.

    Attributes:
        setpoint: ``((sample, value), ...)``, the first at sample 0.
        samples: length.
        load: ``((sample, value), ...)`` disturbance added to the stem, in OP.
        equation_noise: standard deviation of ``v`` in (7).
        measurement_noise: standard deviation added to PV alone.
        seed: of the noise.
        op0: OP (and stem, unless ``stem0``) before the first sample; the plant starts at rest.
        stem0: stem position before the first sample.
        bad_pv: samples at which PV reads NaN.
    """

    setpoint: Sequence[tuple[int, float]]
    samples: int = 900
    load: Sequence[tuple[int, float]] = ()
    equation_noise: float = 0.0
    measurement_noise: float = 0.0
    seed: int = 0
    op0: float = 50.0
    stem0: float | None = None
    bad_pv: frozenset[int] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        if self.samples < 1 or not self.setpoint or self.setpoint[0][0] != 0:
            raise CompensatorError(
                "a study needs samples >= 1 and a set-point that begins at sample 0; got "
                f"samples={self.samples}, setpoint={tuple(self.setpoint)}"
            )


class SteppedPlant(Protocol):
    """A plant that is moved on by hand, from its own equations or an FMU."""

    @property
    def pv(self) -> float:
        """PV now, without measurement noise."""

    @property
    def stem(self) -> float:
        """Stem position under the OP applied last."""

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """Apply ``op`` for one period; return (and keep as ``pv``) PV at its end."""


class Plant:
    """A process behind a valve, one sample at a time.

    Args:
        process: what PV obeys.
        valve: He's valve, any ``(stem, op) -> stem``, or None for a healthy one.
        op0, stem0: as in `Study`.
    """

    def __init__(
        self,
        process: ProcessModel,
        valve: ValveModel | StemLaw | None,
        op0: float,
        stem0: float | None = None,
    ) -> None:
        self.process = process = process.as_controlled()
        self._law = valve.step if isinstance(valve, ValveModel) else valve
        self.stem = op0 if stem0 is None else stem0
        rest = 0.0
        if not process.is_integrating:
            rest = (sum(process.b) * self.stem + process.offset) / (1.0 + sum(process.a))
        self._y = [rest] * max(1, len(process.a))
        self._x = [self.stem] * (process.dead_time + len(process.b) - 1)
        self.pv = rest

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """Apply ``op`` for one period; return (and keep as ``pv``) PV at its end."""
        p = self.process
        self.stem = op if self._law is None else self._law(self.stem, op)
        self._x = [self.stem + load, *self._x[:-1]]
        delay = p.dead_time - 1
        y = p.offset + noise
        y -= sum(a * past for a, past in zip(p.a, self._y, strict=False))
        y += sum(b * past for b, past in zip(p.b, self._x[delay:], strict=True))
        self._y = [y, *self._y[:-1]]
        self.pv = y
        return y


@dataclass(frozen=True, eq=False)
class Trace:
    """Signals of one run, arrays of shape ``(samples,)``; ``op`` and ``stem`` follow ``pv``."""

    pv: Array
    op: Array
    stem: Array
    sp: Array
    status: tuple[ActionStatus, ...]


def _levels(changes: Sequence[tuple[int, float]], samples: int, start: float) -> Array:
    out = np.full(samples, start)
    for sample, value in changes:
        out[sample:] = value
    return out


def run(
    plant: ProcessModel,
    valve: ValveModel | StemLaw | None,
    controller: Controller,
    study: Study,
) -> Trace:
    """Run ``controller`` on ``plant`` behind ``valve``; deterministic for ``study.seed``."""
    return drive(Plant(plant, valve, study.op0, study.stem0), controller, study)


def drive(model: SteppedPlant, controller: Controller, study: Study) -> Trace:
    """Run ``controller`` on a plant that stands at ``study.op0``.

    A plant that makes its own noise is given a study without.
    """
    rng = np.random.default_rng(study.seed)
    n = study.samples
    equation = rng.normal(0.0, 1.0, n) * study.equation_noise
    measurement = rng.normal(0.0, 1.0, n) * study.measurement_noise
    sp = _levels(study.setpoint, n, study.setpoint[0][1])
    load = _levels(study.load, n, 0.0)
    pv, op, stem = np.empty(n), np.empty(n), np.empty(n)
    status: list[ActionStatus] = []
    applied = study.op0
    for k in range(n):
        pv[k] = model.pv + measurement[k]
        seen = math.nan if k in study.bad_pv else float(pv[k])
        controller.observe(seen, applied)
        action = controller.decide(float(sp[k]))
        applied = action.op if math.isfinite(action.op) else applied
        status.append(action.status)
        op[k] = applied
        model.step(applied, float(equation[k]), float(load[k]))
        stem[k] = model.stem
    return Trace(pv, op, stem, sp, tuple(status))


@dataclass(frozen=True, slots=True)
class Performance:
    """Figures of a trace.

    Attributes:
        pv_std: standard deviation of PV around its mean.
        offset: mean of PV minus SP.
        rms: root of the mean square of PV minus SP.
        iae: sum of ``|SP - PV|``.
        travel: way of the stem, in OP.
        op_travel: way of OP, which a positioner has to follow.
        reversals: changes of the stem's direction.
        moves: samples in which the stem moved.
        samples: length.
    """

    pv_std: float
    offset: float
    rms: float
    iae: float
    travel: float
    op_travel: float
    reversals: int
    moves: int
    samples: int


def assess(trace: Trace, start: int = 0, stop: int | None = None) -> Performance:
    """Return the figures of samples ``start`` to ``stop`` of a trace."""
    part = slice(start, stop)
    error = trace.pv[part] - trace.sp[part]
    steps = np.diff(trace.stem[part])
    moves = steps[np.abs(steps) > 1e-9]
    return Performance(
        pv_std=float(np.std(trace.pv[part])),
        offset=float(np.mean(error)),
        rms=float(np.sqrt(np.mean(error**2))),
        iae=float(np.sum(np.abs(error))),
        travel=float(np.sum(np.abs(moves))),
        op_travel=float(np.sum(np.abs(np.diff(trace.op[part])))),
        reversals=int(np.sum(moves[1:] * moves[:-1] < 0.0)),
        moves=int(moves.size),
        samples=int(error.size),
    )


def held_stem_std(process: ProcessModel, equation_noise: float, measurement_noise: float) -> float:
    """Return PV's standard deviation with the stem held: the noise alone, ``v / A(q)``.

    It is the yardstick of a compensator that never moves; infinite for an integrating process.
    """
    if process.is_integrating:
        return math.inf
    poles = np.abs(np.roots(np.concatenate([[1.0], process.a])))
    slowest = float(poles.max()) if poles.size else 0.0
    length = int(np.ceil(40.0 / max(1e-6, -math.log(max(slowest, 1e-9))))) + 10
    pulse: ArrayLike = np.concatenate([[1.0], np.zeros(length)])
    bare = ProcessModel(process.a, (0.0,), 1, 0.0, process.period)
    response = bare.simulate(np.zeros(length + 1), noise=pulse)
    return math.hypot(equation_noise * float(np.linalg.norm(response)), measurement_noise)
