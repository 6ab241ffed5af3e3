"""Processes in state space and valves to choose the compensator's settings on.

Processes are stepped by the matrix exponential, five times a sample. Valves: friction that varies
from slip to slip, Kano's two stops, a stem of bounded speed, and an actuator that lags.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from loop_model import ProcessModel, ValveModel

__all__ = ["PROCESSES", "VALVES", "LinearPlant", "TunedProcess", "TunedValve"]

_PARTS = 5


@dataclass(frozen=True, slots=True)
class TunedProcess:
    """A process around the stem position 50, time in samples.

    Attributes:
        rates: matrix of the states' rates, shape ``(n, n)``; PV is the first state.
        drive: how the flow enters, shape ``(n,)``.
        delay: samples of dead time.
        band, jump: of the valve in its loop.
        curve: flow beyond proportional, per squared stem.
    """

    rates: tuple[tuple[float, ...], ...]
    drive: tuple[float, ...]
    delay: int
    band: float
    jump: float
    curve: float = 0.0

    @property
    def integrating(self) -> bool:
        """Whether PV integrates the flow."""
        return self.rates == ((0.0,),)

    @property
    def gain(self) -> float:
        """PV per stem at rest; of a tank per sample."""
        if self.integrating:
            return self.drive[0]
        return float(-np.linalg.solve(np.array(self.rates), np.array(self.drive))[0])

    def transition(self, duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Return state matrix and input vector over ``duration`` samples."""
        n = len(self.drive)
        joint = np.zeros((n + 1, n + 1))
        joint[:n, :n], joint[:n, n] = self.rates, self.drive
        stepped = expm(joint * duration)
        return stepped[:n, :n], stepped[:n, n]

    def model(self) -> ProcessModel:
        """Return the model that a faultless identification would find."""
        A, B = self.transition(1.0)
        a = np.poly(A)
        # Markov parameters and the denominator give the numerator.
        course, state = [], B.copy()
        for _ in range(len(B)):
            course.append(float(state[0]))
            state = A @ state
        b = np.convolve(course, a)[: len(B)]
        if self.integrating:
            a = np.array([1.0, -1.0])
        return ProcessModel(
            tuple(map(float, a[1:])),
            tuple(map(float, b)),
            self.delay + 1,
            float(-50.0 * b.sum()),
            1.0,
        )


def _lags(*lags: float, gain: float) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
    """Return rates and drive of lags in series."""
    n = len(lags)
    rates = np.zeros((n, n))
    for k, lag in enumerate(lags):
        rates[k, k] = -1.0 / lag
        if k + 1 < n:
            rates[k, k + 1] = 1.0 / lag
    drive = np.zeros(n)
    drive[-1] = gain / lags[-1]
    return tuple(tuple(map(float, row)) for row in rates), tuple(map(float, drive))


_SWING = (((0.0, 1.0), (-0.0225, -0.18)), (0.0, 0.0225 * 1.4))

PROCESSES: dict[str, TunedProcess] = {
    "lag": TunedProcess(*_lags(20.0, gain=0.7), 4, 5.0, 2.5),
    "two lags": TunedProcess(*_lags(12.0, 5.0, gain=2.0), 3, 8.0, 2.0),
    "underdamped": TunedProcess(*_SWING, 2, 5.0, 2.0),
    "tank": TunedProcess(((0.0,),), (0.02,), 4, 6.0, 3.0),
    "small tank": TunedProcess(((0.0,),), (0.05,), 1, 7.0, 2.0),
    "long delay": TunedProcess(*_lags(18.0, gain=0.9), 13, 7.0, 2.5),
    "square": TunedProcess(*_lags(10.0, 10.0, gain=1.0), 3, 4.0, 1.5, curve=0.012),
}


class TunedValve:
    """He's valve whose static friction varies by 5 % from slip to slip."""

    speed = math.inf
    lag = 0.0
    variation = 0.05

    def __init__(self, band: float, jump: float, at: float, rng: np.random.Generator) -> None:
        self.band, self.jump, self.stem = band, jump, at
        self._rng, self._pressure, self._share, self._moves = rng, at, 1.0, False

    def move(self, op: float, dt: float) -> float:
        """Return the stem after ``dt`` samples with ``op`` applied."""
        share = 1.0 if self.lag == 0.0 else -math.expm1(-dt / self.lag)
        before, self._pressure = self._pressure, self._pressure + share * (op - self._pressure)
        pushed = abs(self._pressure - before)
        model = ValveModel(self.band, self.jump)
        force = self._pressure - self.stem
        if not self._moves and abs(force) > self._share * model.static_friction:
            self._moves = self.band > 0.0 or force != 0.0
            self._share = 1.0 + self.variation * float(self._rng.normal())
        if self._moves:
            way = abs(force) - model.dynamic_friction
            if way <= 0.0:
                self._moves = False
                return self.stem
            step = min(way, self.speed * dt)
            self.stem += math.copysign(step, force)
            # A stem in motion follows as long as the pressure rises.
            self._moves = step < way or (self.lag > 0.0 and pushed > 0.02 * self.band)
        return self.stem


class Steady(TunedValve):
    """He's valve whose friction does not vary."""

    variation = 0.0


class Slow(TunedValve):
    """A stem that moves at a bounded speed once it has slipped."""

    speed = 2.0


class Lagging(TunedValve):
    """An actuator that lags by half a sample."""

    lag = 0.5


class TwoStops(TunedValve):
    """Kano's valve: from the OP at which it stopped, J must be overcome onwards, S backwards."""

    def __init__(self, band: float, jump: float, at: float, rng: np.random.Generator) -> None:
        super().__init__(band, jump, at, rng)
        self._op, self._held, self._up, self._stuck = at, at, True, True

    def move(self, op: float, dt: float) -> float:  # noqa: ARG002
        """See `TunedValve.move`."""
        if op == self._op:
            if not self._stuck:
                self._stuck, self._held = True, op
            return self.stem
        up, before, self._op = op > self._op, self._op, op
        if not self._stuck and up != self._up:
            self._stuck, self._held = True, before
        if self._stuck:
            onwards = op - self._held if self._up else self._held - op
            if -onwards > self.band:
                self._up = not self._up
            elif onwards <= self.jump:
                return self.stem
            self._stuck = False
        side = 1.0 if self._up else -1.0
        self.stem = op - 0.5 * side * (self.band - self.jump)
        return self.stem


VALVES: dict[str, type[TunedValve]] = {
    "varying": TunedValve,
    "steady": Steady,
    "two stops": TwoStops,
    "slow": Slow,
    "lagging": Lagging,
}


class LinearPlant:
    """A process behind a valve, one sample at a time; PV is the deviation from rest.

    Args:
        process: of `PROCESSES`.
        valve: the stem.
    """

    def __init__(self, process: TunedProcess, valve: TunedValve) -> None:
        self.valve = valve
        self._A, self._B = process.transition(1.0 / _PARTS)
        self._curve: Callable[[float], float] = lambda u: u + process.curve * u * abs(u)
        self._state = np.zeros(len(process.drive))
        first = self._curve(valve.stem - 50.0)
        self._late: deque[float] = deque([first] * (process.delay * _PARTS))

    @property
    def pv(self) -> float:
        """PV without measurement noise."""
        return float(self._state[0])

    def step(self, op: float, load: float = 0.0, noise: float = 0.0) -> float:
        """Apply ``op`` for a sample; ``load`` is added to the flow, ``noise`` drives PV itself."""
        for _ in range(_PARTS):
            self._late.append(self._curve(self.valve.move(op, 1.0 / _PARTS) - 50.0) + load)
            self._state = self._A @ self._state + self._B * self._late.popleft()
        self._state[0] += noise
        return self.pv
