"""Plants written apart from the product, in continuous time, for reporting only.

Nothing here is shared with the product or with the plants that settings were chosen on: processes
are ordinary differential equations in tenths of a sample, friction is written from the papers.

* `He`: He, Q. P. et al. (2007), *A curve fitting method for detecting valve stiction*.
* `Kano`: Kano, M. et al. (2004), *Practical model and detection algorithm for valve stiction*.
* `Sliding`: a stem that sticks, then slides at a bounded speed to where the force holds it.
* `Karnopp`: Karnopp, D. (1985), mass and spring, behind an actuator with a lag.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["PROCESSES", "VALVES", "ApartPlant", "Process", "Valve"]

_STEPS = 10


class Valve:
    """A stem that follows OP; `move` by one part of a sample."""

    def __init__(self, band: float, jump: float, at: float) -> None:
        self.band, self.jump, self.stem = band, jump, at

    def move(self, op: float, dt: float) -> float:
        """Return the stem after ``dt`` samples with ``op`` applied."""
        raise NotImplementedError


class He(Valve):
    """Sticks until the force exceeds ``(S + J) / 2``, then lands ``(S - J) / 2`` short."""

    def move(self, op: float, dt: float) -> float:  # noqa: ARG002
        """See `Valve.move`."""
        force = op - self.stem
        if abs(force) > 0.5 * (self.band + self.jump):
            self.stem = op - math.copysign(0.5 * (self.band - self.jump), force)
        return self.stem


class Kano(Valve):
    """From the OP at which it stopped, J must be overcome onwards and S backwards."""

    def __init__(self, band: float, jump: float, at: float) -> None:
        super().__init__(band, jump, at)
        self._stopped, self._last, self._way = at, at, 1.0
        self._sticks = True

    def move(self, op: float, dt: float) -> float:  # noqa: ARG002
        """See `Valve.move`."""
        change = op - self._last
        self._last = op
        if change == 0.0:
            if not self._sticks:
                self._sticks, self._stopped = True, op
            return self.stem
        way = math.copysign(1.0, change)
        if not self._sticks and way != self._way:
            self._sticks, self._stopped = True, op - change
        if self._sticks:
            beyond = self._way * (op - self._stopped)
            if -beyond > self.band:
                self._way = -self._way
            elif beyond <= self.jump:
                return self.stem
            self._sticks = False
        self.stem = op - 0.5 * self._way * (self.band - self.jump)
        return self.stem


class Sliding(Valve):
    """Breaks away like `He`, and then slides at most ``speed`` in a sample."""

    speed = 6.0

    def __init__(self, band: float, jump: float, at: float) -> None:
        super().__init__(band, jump, at)
        self._goal = at

    def move(self, op: float, dt: float) -> float:
        """See `Valve.move`."""
        force = op - self._goal
        if abs(force) > 0.5 * (self.band + self.jump):
            self._goal = op - math.copysign(0.5 * (self.band - self.jump), force)
        way = self._goal - self.stem
        self.stem += math.copysign(min(abs(way), self.speed * dt), way)
        return self.stem


class Karnopp(Valve):
    """Mass, spring and Coulomb friction behind an actuator that lags by ``lag`` samples."""

    lag = 0.15
    mass, damping = 2e-4, 0.02

    def __init__(self, band: float, jump: float, at: float) -> None:
        super().__init__(band, jump, at)
        self._pressure, self._speed = at, 0.0

    def move(self, op: float, dt: float) -> float:
        """See `Valve.move`."""
        static, dynamic = 0.5 * (self.band + self.jump), 0.5 * (self.band - self.jump)
        parts = 8
        for _ in range(parts):
            h = dt / parts
            self._pressure += (op - self._pressure) * (1.0 - math.exp(-h / self.lag))
            force = self._pressure - self.stem
            if self._speed == 0.0 and abs(force) <= static:
                continue
            way = math.copysign(1.0, self._speed if self._speed != 0.0 else force)
            goal = (force - way * dynamic) / self.damping
            speed = goal + (self._speed - goal) * math.exp(-h * self.damping / self.mass)
            if speed * way <= 0.0:
                self._speed = 0.0
                continue
            self._speed = speed
            self.stem += h * speed
        return self.stem


VALVES: dict[str, type[Valve]] = {
    "He": He,
    "Kano": Kano,
    "sliding": Sliding,
    "Karnopp": Karnopp,
}


@dataclass(frozen=True, slots=True)
class Process:
    """States of an ordinary differential equation, per sample.

    Attributes:
        rates: derivative of the states under a flow.
        delay: samples of dead time.
        flow: of a stem position.
        rest: states at rest with the stem at 50.
        gain: PV per stem at 50; per sample when ``integrating``.
    """

    rates: Callable[[list[float], float], list[float]]
    delay: int
    rest: tuple[float, ...]
    gain: float
    flow: Callable[[float], float] = field(default=lambda stem: stem)
    integrating: bool = False


def _lag(tau: float, gain: float) -> Callable[[list[float], float], list[float]]:
    return lambda x, u: [(gain * (u - 50.0) - x[0]) / tau]


def _tank(gain: float) -> Callable[[list[float], float], list[float]]:
    return lambda _, u: [gain * (u - 50.0)]


def _two_lags(one: float, two: float, gain: float) -> Callable[[list[float], float], list[float]]:
    return lambda x, u: [(x[1] - x[0]) / one, (gain * (u - 50.0) - x[1]) / two]


def _swing(w: float, z: float, gain: float) -> Callable[[list[float], float], list[float]]:
    return lambda x, u: [x[1], w * w * (gain * (u - 50.0) - x[0]) - 2.0 * z * w * x[1]]


def _equal_percentage(stem: float) -> float:
    """Flow of an equal-percentage trim with a rangeability of 8, straight at 50."""
    slope = math.log(8.0) / 100.0
    return 50.0 + math.expm1(slope * (stem - 50.0)) / slope


PROCESSES: dict[str, Process] = {
    "first order": Process(_lag(9.0, 1.3), 2, (0.0,), 1.3),
    "second order, oscillatory": Process(_swing(0.22, 0.45, 0.9), 2, (0.0, 0.0), 0.9),
    "level": Process(_tank(0.018), 2, (0.0,), 0.018, integrating=True),
    "dead time of ten": Process(_lag(14.0, 1.1), 10, (0.0,), 1.1),
    "curved gain": Process(_two_lags(8.0, 3.0, 1.2), 2, (0.0, 0.0), 1.2, flow=_equal_percentage),
}


class ApartPlant:
    """A process behind a valve, one sample at a time; PV is the deviation from rest.

    Args:
        process: of `PROCESSES`.
        valve: the stem.
    """

    def __init__(self, process: Process, valve: Valve) -> None:
        self.process, self.valve = process, valve
        self._states = list(process.rest)
        self._flows: deque[float] = deque([process.flow(valve.stem)] * (process.delay * _STEPS))
        self.noise = 0.0

    @property
    def pv(self) -> float:
        """PV without measurement noise."""
        return self._states[0]

    def step(self, op: float, load: float = 0.0, noise: float = 0.0) -> float:
        """Apply ``op`` for a sample; ``load`` is added to the flow, ``noise`` drives PV itself."""
        h = 1.0 / _STEPS
        for _ in range(_STEPS):
            self._flows.append(self.process.flow(self.valve.move(op, h)) + load)
            late = self._flows.popleft()
            middle = [
                x + 0.5 * h * r
                for x, r in zip(self._states, self.process.rates(self._states, late), strict=True)
            ]
            slopes = self.process.rates(middle, late)
            self._states = [x + h * r for x, r in zip(self._states, slopes, strict=True)]
        self._states[0] += noise
        return self.pv
