"""The loop as a linear system: identified process and running controller, closed.

    loop = LinearLoop.of(process, controller)
    loop.margins(), loop.closed_poles()

``process`` is a `loop_model.ProcessModel`; the controller's settings are brought to the process's
sampling period. All frequencies are in cycles a sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.controller.controller import Controller
from loop_model import ProcessModel

__all__ = ["TURNS", "LinearLoop", "Margins"]

Complex = NDArray[np.complex128]

_GRID = np.geomspace(2e-4, 0.5, 1500)
"""Frequencies at which margins are read, cycles a sample."""

TURNS = np.exp(-2j * math.pi * _GRID)
"""``q^-1`` at these frequencies, ``(f,)``."""


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins of a loop.

    Attributes:
        gain: factor on the gain that makes the loop swing for ever; infinite where none does.
        phase_deg: phase margin in degrees, below zero where the loop swings ever wider; infinite
            where the gain never reaches one.
        sensitivity: largest amplification of a disturbance, Ms; SIMC's loops have 1.6 to 1.7.
        frequency: where Ms is, cycles a sample.
        stable: whether all closed-loop poles are inside the unit circle.
    """

    gain: float
    phase_deg: float
    sensitivity: float
    frequency: float
    stable: bool


@dataclass(frozen=True)
class LinearLoop:
    """Process ``q^-d B/A`` and controller ``R/T`` as polynomials in ``q^-1``.

    Attributes:
        a, b: of the process, the dead time in ``b``.
        r, t: of the controller from error to OP.
        period: seconds between samples.
    """

    a: Array
    b: Array
    r: Array
    t: Array
    period: float

    @classmethod
    def of(cls, process: ProcessModel, controller: Controller) -> LinearLoop:
        """The loop of a process and a controller."""
        h = process.period
        kp, ki = controller.gain, controller.integral_rate * h
        kd = controller.gain * controller.derivative_time_s / h
        pole = math.exp(-h / controller.filter_time_s) if controller.filter_time_s > 0.0 else 0.0
        slow, quick = np.array([kp + ki, -kp]), kd * np.array([1.0, -2.0, 1.0])
        if controller.filter_on == "derivative":
            r = np.convolve(slow, [1.0, -pole]) + (1.0 - pole) * quick
        else:
            r = (np.append(slow, 0.0) + quick) * (1.0 - pole)
        b = np.concatenate([np.zeros(controller.samples_late(process.dead_time)), process.b])
        t = np.convolve([1.0, -1.0], [1.0, -pole])
        return cls(np.array([1.0, *process.a]), b, r, t, h)

    def process_response(self, frequency: Array) -> Complex:
        """Frequency response of the process."""
        return _ratio(self.b, self.a, np.exp(-2j * math.pi * frequency))

    def open_loop(self, frequency: Array) -> Complex:
        """Frequency response of process and controller in series."""
        return self._open_loop(np.exp(-2j * math.pi * frequency))

    def sensitivity(self, frequency: Array) -> Complex:
        """From a disturbance on PV to PV in closed loop."""
        return np.asarray(1.0 / (1.0 + self.open_loop(frequency)))

    def characteristic(self) -> Array:
        """The closed loop's characteristic polynomial in ``q^-1``."""
        first, second = np.convolve(self.a, self.t), np.convolve(self.b, self.r)
        size = max(first.size, second.size)
        return np.pad(first, (0, size - first.size)) + np.pad(second, (0, size - second.size))

    def closed_poles(self) -> Complex:
        """Poles of the closed loop."""
        return self._poles

    def swing(self) -> tuple[float, float]:
        """Period in samples and damping ratio of the least damped swinging pole; (inf, 1) if none.

        A negative damping is a loop that is not stable.
        """
        poles = self.closed_poles()
        poles = poles[(poles.imag > 1e-9) & (np.abs(poles) > 1e-6)]
        if poles.size == 0:
            return math.inf, 1.0
        logs = np.log(poles)
        damping = -logs.real / np.abs(logs)
        i = int(np.argmin(damping))
        return 2.0 * math.pi / float(abs(logs[i].imag)), float(damping[i])

    def margins(self) -> Margins:
        """Gain margin, phase margin and largest sensitivity."""
        return self._margins

    @cached_property
    def _poles(self) -> Complex:
        return np.asarray(np.roots(self.characteristic()), dtype=np.complex128)

    @cached_property
    def _margins(self) -> Margins:
        found = self._open_loop(TURNS)
        turned = (np.sign(found.imag[1:]) != np.sign(found.imag[:-1])) & (found.real[1:] < 0.0)
        largest = float(np.max(-found.real[1:][turned])) if turned.any() else 0.0
        size = np.abs(found)
        falls = (size[1:] < 1.0) & (size[:-1] >= 1.0)
        # of the open loop turned by half a circle: below zero where the loop is not stable
        angles = np.degrees(np.angle(-found[1:][falls]))
        amplified = np.abs(1.0 / (1.0 + found))
        at = int(np.argmax(amplified))
        return Margins(
            gain=1.0 / largest if largest > 0.0 else math.inf,
            phase_deg=float(angles[np.argmin(np.abs(angles))]) if angles.size else math.inf,
            sensitivity=float(amplified[at]),
            frequency=float(_GRID[at]),
            stable=bool(np.abs(self.closed_poles()).max(initial=0.0) < 1.0),
        )

    def _open_loop(self, z: Complex) -> Complex:
        return _ratio(self.b, self.a, z) * _ratio(self.r, self.t, z)


def _ratio(top: Array, bottom: Array, z: Complex) -> Complex:
    return np.asarray(np.polyval(top[::-1], z) / np.polyval(bottom[::-1], z))
