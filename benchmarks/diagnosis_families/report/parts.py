"""What a loop of the report family is made of: plant, valve, controller and sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import signal

from benchmarks.diagnosis_families.records import Floats

__all__ = ["Controller", "Plant", "Sensor", "Valve"]

STEPS = 5
"""Inner steps of the plant in a sample."""


class Plant:
    """``K e^(-Ls) / ((T1 s + 1)(T2 s + 1))``, or ``K e^(-Ls) / (s (T2 s + 1))`` as a level."""

    def __init__(self, gain: float, first: float, second: float, dead: float, level: bool) -> None:
        self.gain, self.first, self.second, self.dead, self.level = gain, first, second, dead, level
        lead = [1.0, 0.0] if level else [first, 1.0]
        a, b, c, _ = signal.tf2ss([gain], np.polymul(lead, [max(second, 0.05), 1.0]))
        self._a, self._b, *_ = signal.cont2discrete((a, b, c, np.zeros((1, 1))), 1.0 / STEPS)
        self._c = c[0]
        self._state = np.zeros(2)
        self._line = [0.0] * (round(dead * STEPS) + 1)

    def step(self, flow: float) -> float:
        """The output after one sample with this flow into it."""
        b = self._b[:, 0]
        for _ in range(STEPS):
            self._line.append(flow)
            self._state = self._a @ self._state + b * self._line.pop(0)
        return float(self._c @ self._state)

    def matrices(self) -> tuple[Floats, Floats, Floats]:
        """State space of an inner step: ``(2, 2)``, ``(2,)``, ``(2,)``."""
        return self._a, self._b[:, 0], self._c

    def line_length(self) -> int:
        """Dead time in inner steps."""
        return len(self._line)

    def simc(self, closed: float) -> tuple[float, float]:
        """Gain and integral time by Skogestad (2003); closed-loop time in dead times."""
        late = self.dead + 0.5 + 0.5 * self.second
        wait = (1.0 + closed) * late
        if self.level:
            return 1.0 / self.gain / wait, 4.0 * wait
        lag = self.first + 0.5 * self.second
        return lag / self.gain / wait, min(lag, 4.0 * wait)

    def ultimate(self, integral: float) -> float:
        """The PI gain at which the loop swings for ever, for that integral time."""
        w = np.geomspace(1e-3, 3.0, 6000)
        s = 1j * w
        core = (1.0 / s if self.level else 1.0 / (self.first * s + 1.0)) / (self.second * s + 1.0)
        # the sample and hold of one sample adds half of one, the measurement the other
        found = core * np.exp(-s * (self.dead + 0.5)) * (1.0 + 1.0 / (integral * s))
        turn = (np.sign(found.imag[1:]) != np.sign(found.imag[:-1])) & (found.real[1:] < 0.0)
        return 1.0 / float(np.max(-found.real[1:][turn])) / self.gain


@dataclass
class Valve:
    """Kano's valve (2004) with stick band S and slip jump J, 0 for a healthy one.

    ``shape`` bends the characteristic: the factor by which the gain grows from the middle of OP to
    its end, squared; 0 for a straight one.
    """

    stick: float = 0.0
    jump: float = 0.0
    shape: float = 0.0
    stem: float = 50.0
    last: float = 50.0
    turned: float = 50.0
    way: float = 0.0
    stopped: bool = True

    def flow(self, u: float) -> float:
        """Flow about the middle for a controller output."""
        if self.stick > 0.0:
            move = u - self.last
            if move * self.way <= 0.0 and move != 0.0 and not self.stopped:
                self.stopped, self.turned = True, self.last
            if self.stopped:
                away = u - self.turned
                if away * self.way > self.jump and self.way != 0.0:
                    self.stopped = False
                elif abs(away) > self.stick:
                    self.way, self.stopped = math.copysign(1.0, away), False
            if not self.stopped and move != 0.0:
                self.stem = u - self.way * 0.5 * (self.stick - self.jump)
            self.last = u
        else:
            self.stem = u
        x = (self.stem - 50.0) / 50.0
        if self.shape == 0.0:
            return 50.0 * x
        # gain from 1 / shape^2 of the middle's to shape^2 over the range, never turning back
        rate = 2.0 * math.log(self.shape)
        return 50.0 * math.expm1(rate * x) / rate


@dataclass
class Controller:
    """PI(D) in position form with back-calculation; direct or reverse by the sign of the gain."""

    gain: float
    integral: float
    derivative: float = 0.0
    low: float = 0.0
    high: float = 100.0
    state: float = 50.0
    slope: float = 0.0
    before: float | None = None

    def step(self, target: float, measured: float) -> float:
        """OP of a sample."""
        error = target - measured
        self.state += self.gain * error / self.integral
        rate = 0.0 if self.before is None else measured - self.before
        self.before = measured
        wanted = self.state + self.gain * error - self.gain * self.derivative * rate
        out = min(max(wanted, self.low), self.high)
        self.state += out - wanted
        return out

    def follow(self, op: float, target: float, measured: float) -> None:
        """Keep bumpless while somebody sets OP by hand."""
        self.before = measured
        self.state = op - self.gain * (target - measured)


@dataclass
class Sensor:
    """Noise, spikes, resolution and a time in which it stands still."""

    noise: float
    rng: np.random.Generator
    spikes: float = 0.0
    spike_size: float = 0.0
    step: float = 0.0
    frozen: tuple[int, int] = (0, 0)
    held: float = field(default=0.0)

    def read(self, value: float, k: int) -> float:
        """The reading of sample ``k``."""
        out = value + self.noise * self.rng.standard_normal()
        if self.spikes and self.rng.random() < self.spikes:
            out += self.spike_size * (1.0 if self.rng.random() < 0.5 else -1.0)
        if self.step:
            out = round(out / self.step) * self.step
        if self.frozen[0] < k < self.frozen[1]:
            return self.held
        self.held = out
        return out
