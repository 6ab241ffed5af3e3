"""Loops of the reporting family: own controllers, nominal models, disturbances, one run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Protocol

import numpy as np
from scipy import signal

from benchmarks.apart.plants import PROCESSES, VALVES, ApartPlant, Process
from compensator import (
    Action,
    ActionStatus,
    Controller,
    MpcSettings,
    Supervisor,
    UnawareMpc,
    Uncertainty,
)
from estimator import identify
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = [
    "DISTURBANCES",
    "UNREACHED",
    "WARM",
    "WRONG",
    "Course",
    "Loop",
    "Plant",
    "asked_way",
    "nominal",
    "play",
]

WARM, SAMPLES = 800, 1700
UNREACHED = range(1000, 1200)
"""Scans of the disturbance "saturation" in which the set-point is out of reach."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A loop of the family.

    Attributes:
        process, valve: names in `PROCESSES` and `VALVES`.
        own: ``pi`` or ``mpc``, the loop's own controller.
        band, jump: of the valve.
        noise: standard deviation of the measurement, as a share of what a slip makes of PV.
        driven: whether the noise enters the process instead of the measurement.
    """

    process: str
    valve: str
    own: str
    band: float = 6.0
    jump: float = 2.0
    noise: float = 0.05
    driven: bool = False

    @property
    def scale(self) -> float:
        """PV that one OP makes; of a level what comes up within twenty samples."""
        p = PROCESSES[self.process]
        return p.gain * (20.0 if p.integrating else 1.0)

    def make_plant(self, seed: int) -> Plant:  # noqa: ARG002
        """Return the plant at rest near 49; the valves of this family know no chance."""
        valve = VALVES[self.valve](self.band, self.jump, 49.0)
        return ApartPlant(PROCESSES[self.process], valve)

    def make_controller(self) -> Controller:
        """Return the loop's own controller."""
        process = PROCESSES[self.process]
        if self.own == "pi":
            return _OwnPi(process)
        weight = 0.15 if process.integrating else MpcSettings().op_weight
        return UnawareMpc(nominal(process), MpcSettings(op_weight=weight))

    def true_model(self) -> LoopModel:
        """Return the valve and the process at its working point."""
        return LoopModel(ValveModel(self.band, self.jump), nominal(PROCESSES[self.process]))


class Stem(Protocol):
    """A valve whose friction can be changed."""

    band: float
    jump: float

    @property
    def stem(self) -> float:
        """Position."""


class Plant(Protocol):
    """A process behind a valve."""

    @property
    def valve(self) -> Stem:
        """The valve."""

    @property
    def pv(self) -> float:
        """PV without measurement noise."""

    def step(self, op: float, load: float = 0.0, noise: float = 0.0) -> float:
        """Apply ``op`` for a sample."""


class _OwnPi:
    """PI in velocity form, tuned by hand to be brisk, as loops that oscillate are."""

    def __init__(self, process: Process) -> None:
        if process.integrating:
            self._gain, self._reset = 0.25 / (process.gain * (process.delay + 3.0)), 40.0
        else:
            self._gain = 4.5 / (process.gain * (process.delay + 6.0))
            self._reset = 9.0 + process.delay / 3.0
        self._error: float | None = None
        self._op = self._pv = math.nan

    def observe(self, pv: float, op: float) -> None:
        """Take in a scan."""
        self._op = op
        self._pv = pv

    def decide(self, sp: float) -> Action:
        """Return the next OP."""
        if not math.isfinite(self._pv):
            return Action(self._op, ActionStatus.PV_BAD)
        error = sp - self._pv
        before = error if self._error is None else self._error
        self._error = error
        op = self._op + self._gain * (error - before + error / self._reset)
        return Action(min(max(op, 0.0), 100.0), ActionStatus.OPTIMAL)


def nominal(process: Process) -> ProcessModel:
    """Return the linear model at 50 of a process, sampled exactly."""
    n, h = len(process.rest), 1e-5
    base = process.rates(list(process.rest), 50.0)
    A, B = np.zeros((n, n)), np.zeros((n, 1))
    for j in range(n):
        moved = [x + h * (i == j) for i, x in enumerate(process.rest)]
        A[:, j] = (np.array(process.rates(moved, 50.0)) - base) / h
    B[:, 0] = (np.array(process.rates(list(process.rest), 50.0 + h)) - base) / h
    C = np.zeros((1, n))
    C[0, 0] = 1.0
    Ad, Bd, *_ = signal.cont2discrete((A, B, C, np.zeros((1, 1))), 1.0)
    num, den = signal.ss2tf(Ad, Bd, C, np.zeros((1, 1)))
    a = np.real(den[1:])
    if process.integrating:
        a = np.array([-1.0])
    b = np.real(num[0, 1:])
    offset = -50.0 * float(b.sum())
    return ProcessModel(tuple(map(float, a)), tuple(map(float, b)), process.delay + 1, offset, 1.0)


def _valve(model: LoopModel, factor: float) -> LoopModel:
    v = model.valve
    return replace(model, valve=ValveModel(factor * v.stick_band, factor * v.slip_jump))


def _gain(model: LoopModel, factor: float) -> LoopModel:
    p = model.process
    scaled = tuple(factor * b for b in p.b)
    return replace(model, process=replace(p, b=scaled, offset=factor * p.offset))


def _later(model: LoopModel, samples: int) -> LoopModel:
    p = model.process
    return replace(model, process=replace(p, dead_time=max(1, p.dead_time + samples)))


WRONG: dict[str, Callable[[LoopModel], LoopModel]] = {
    "exact": lambda m: m,
    "valve x 0.5": lambda m: _valve(m, 0.5),
    "valve x 0.8": lambda m: _valve(m, 0.8),
    "valve x 1.2": lambda m: _valve(m, 1.2),
    "valve x 1.5": lambda m: _valve(m, 1.5),
    "gain x 0.5": lambda m: _gain(m, 0.5),
    "gain x 0.8": lambda m: _gain(m, 0.8),
    "gain x 1.2": lambda m: _gain(m, 1.2),
    "gain x 1.5": lambda m: _gain(m, 1.5),
    "dead time + 3": lambda m: _later(m, 3),
    "dead time - 3": lambda m: _later(m, -3),
    "sign wrong": lambda m: _gain(m, -1.0),
}
DISTURBANCES = (
    "none",
    "ramps",
    "load step",
    "pulse",
    "saturation",
    "manual",
    "wear",
    "healing",
    "frozen",
    "quantised",
    "jitter",
    "restart",
)


@dataclass(frozen=True, eq=False)
class Course:
    """One run: signals of shape ``(SAMPLES,)`` and who had the loop."""

    error: np.ndarray
    stem: np.ndarray
    op: np.ndarray
    compensating: np.ndarray
    reason: str
    offered: bool


def _identified(
    op: np.ndarray, pv: np.ndarray, sp: np.ndarray
) -> tuple[LoopModel | None, Uncertainty]:
    """Return the model that a window gives, and the uncertainty that its block would state."""
    found = identify(op, pv, sp=sp, period=1.0)
    if found.verdict.value != "stiction":
        return None, Uncertainty()
    widths = 2.0 * NormalDist().inv_cdf(0.5 + 0.5 * found.confidence)
    static, dynamic = (
        (i.high - i.low) / widths for i in (found.static_friction, found.dynamic_friction)
    )
    return found.model, Uncertainty(static, dynamic)


def play(loop: Loop, wrong: str, disturbance: str, seed: int) -> Course:
    """Run a loop under its own controller until `WARM`, then with a model on offer.

    With ``wrong="none"`` there is no offer: the loop's own controller goes on.
    """
    rng = np.random.default_rng(seed)
    plant = loop.make_plant(seed)
    size = loop.noise * loop.jump * loop.scale
    white = rng.normal(0.0, 1.0, SAMPLES) * size
    supervisor = Supervisor(loop.make_controller())
    model: LoopModel | None = WRONG[wrong](loop.true_model()) if wrong in WRONG else None
    stated = Uncertainty()
    pv, sp, op, stem = (np.zeros(SAMPLES) for _ in range(4))
    held = np.zeros(SAMPLES, dtype=bool)
    applied, offered = 50.0, False
    for k in range(SAMPLES):
        sp[k] = _setpoint(loop, disturbance, k)
        seen = plant.pv + (0.0 if loop.driven else white[k])
        if disturbance == "quantised":
            quantum = 0.3 * loop.jump * loop.scale
            seen = quantum * round(seen / quantum)
        if disturbance == "frozen" and 1200 <= k < 1300:
            seen = pv[1199]
        pv[k] = seen
        if k == WARM or (disturbance == "restart" and k in (1100, 1300)):
            if k > WARM:
                memory = supervisor.memory
                supervisor = Supervisor(loop.make_controller())
                supervisor.restore(memory)
            if wrong == "identified" and k == WARM:
                model, stated = _identified(op[100:k], pv[100:k], sp[100:k])
            offered = model is not None and supervisor.offer(model, stated)
        manual = disturbance == "manual" and (780 <= k < 800 or 1200 <= k < 1260)
        action = supervisor.step(seen, float(sp[k]), applied, automatic=not manual)
        applied = applied if manual or not math.isfinite(action.op) else action.op
        if disturbance == "wear":
            plant.valve.band = loop.band * (1.0 + 0.5 * max(0, k - WARM) / 900.0)
        elif disturbance == "healing" and k >= 1200:
            plant.valve.band = plant.valve.jump = 0.0
        op[k], held[k] = applied, supervisor.compensating
        if not (disturbance == "jitter" and rng.random() < 0.05):
            plant.step(applied, _load(loop, disturbance, k), white[k] if loop.driven else 0.0)
        stem[k] = plant.valve.stem
    return Course(pv - sp, stem, op, held, supervisor.reason.name.lower(), offered)


def _setpoint(loop: Loop, disturbance: str, k: int) -> float:
    first = 0.4 * loop.band * loop.scale if k >= 20 else 0.0
    if disturbance == "ramps" and k >= WARM:
        swing = abs((k - WARM) % 400 - 200) / 200.0  # 1, down to 0, up to 1
        return first + (1.0 - swing) * 2.0 * loop.band * loop.scale
    if disturbance == "saturation" and k in UNREACHED:
        return first + 80.0 * loop.scale
    return first


def asked_way(loop: Loop, disturbance: str) -> np.ndarray:
    """Return how far the stem has to go in each scan to follow the set-point, shape
    ``(SAMPLES,)``.

    A stem without friction goes as far as the set-point over the gain (a level: as far as the
    slope of the set-point over the gain); one that slips may have to go one slip jump farther
    where the set-point turns.
    """
    asked = np.zeros(SAMPLES)
    if disturbance != "ramps":
        return asked
    process = loop.true_model().process
    slope = np.diff([_setpoint(loop, disturbance, k) for k in range(SAMPLES)], prepend=0.0)
    slope[: WARM + 1] = 0.0
    turns = np.diff(np.sign(slope), prepend=0.0) != 0.0
    if process.is_integrating:
        asked = np.abs(np.diff(slope, prepend=0.0)) / abs(sum(process.b))
    else:
        asked = np.abs(slope / process.gain)
    way: np.ndarray = asked + loop.jump * turns
    return way


def _load(loop: Loop, disturbance: str, k: int) -> float:
    if disturbance == "load step":
        return 0.5 * loop.band if k >= 1100 else 0.0
    if disturbance == "pulse":
        return loop.band if 1100 <= k < 1108 else 0.0
    return 0.0
