"""Linear processes with a sensor, and the controllers that an engineer would give them.

Times are in scans of the controller. A process is two lags, an integrator with a lag, or an
under-damped second-order system; a sensor lag follows. Tunings are SIMC's (Skogestad 2003), made
faster or slower, and then kept at a given gain margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ["Process", "tune"]

SHORTEST_LAG = 0.05
"""Scans; a lag below it is not seen by the controller."""


@dataclass(frozen=True)
class Process:
    """Gain in PV per percent; `form` is "lags", "integrating" or "oscillatory".

    `lag` is the first lag, the integrating time, or 1 / natural frequency; `second` the second lag,
    or the damping ratio of an oscillatory process.
    """

    form: str
    gain: float
    lag: float
    second: float
    sensor_lag: float
    dead_time: float

    def _matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A and B of three states; the last is the sensor's reading, the middle the true value."""
        sensor = 1.0 / max(self.sensor_lag, SHORTEST_LAG)
        a = np.zeros((3, 3))
        b = np.zeros(3)
        a[2] = [0.0, sensor, -sensor]
        if self.form == "oscillatory":
            w = 1.0 / self.lag
            a[0] = [-2.0 * self.second * w, -w * w, 0.0]
            a[1] = [1.0, 0.0, 0.0]
            b[0] = w * w
            return a, b
        second = 1.0 / max(self.second, SHORTEST_LAG)
        a[0, 0] = 0.0 if self.form == "integrating" else -1.0 / self.lag
        b[0] = 1.0 / self.lag
        a[1] = [second, -second, 0.0]
        return a, b

    def discretise(self, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Exact transition and input vector for 1 / `steps` of a scan with a held input."""
        a, b = self._matrices()
        block = np.zeros((4, 4))
        block[:3, :3], block[:3, 3] = a / steps, b / steps
        e = expm(block)
        return e[:3, :3], e[:3, 3]

    def respond(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Frequency response per unit of gain, with the hold's half scan; rad per scan."""
        s = 1j * frequency
        if self.form == "oscillatory":
            core = 1.0 / ((self.lag * s) ** 2 + 2.0 * self.second * self.lag * s + 1.0)
        elif self.form == "integrating":
            core = 1.0 / (self.lag * s * (1.0 + self.second * s))
        else:
            core = 1.0 / ((1.0 + self.lag * s) * (1.0 + self.second * s))
        return core * np.exp(-s * (self.dead_time + 0.5)) / (1.0 + self.sensor_lag * s)


def tune(
    process: Process, speed: float, derivative: float, margin: float, *, exact: bool = False
) -> tuple[float, float, float]:
    """Gain, integral and derivative time by SIMC.

    Args:
        process: to be controlled.
        speed: closed-loop time constant over the effective dead time; SIMC's own choice is 1.
        derivative: derivative time over the dead time; 0 for PI.
        margin: least gain margin; the gain is lowered to reach it.
        exact: raise or lower the gain until the gain margin is `margin`.
    """
    if process.form == "oscillatory":
        wait = process.dead_time + 0.5 + process.sensor_lag
        closed = speed * (wait + process.lag)
        integral = 2.0 * process.second * process.lag
        gain = integral / (closed + wait)
    else:
        small = process.second / 2.0 + process.sensor_lag
        wait = process.dead_time + 0.5 + small
        closed = speed * wait
        lag = process.lag + process.second / 2.0
        gain = lag / (closed + wait)
        integral = 4.0 * (closed + wait)
        if process.form == "lags":
            integral = min(lag, integral)
    integral_time, derivative_time = max(integral, 1.0), derivative * wait
    frequency = np.geomspace(1e-4, 3.1, 2000)
    s = 1j * frequency
    open_loop = (
        gain
        * (1.0 + 1.0 / (integral_time * s) + derivative_time * s / (1.0 + s))
        * process.respond(frequency)
    )
    # Gain at each crossing of -180 degrees: imaginary part changes sign on the negative real side.
    crosses = (np.sign(open_loop.imag[1:]) != np.sign(open_loop.imag[:-1])) & (
        open_loop.real[1:] < 0.0
    )
    largest = float(np.max(-open_loop.real[1:][crosses])) if crosses.any() else 0.0
    factor = 1.0
    if largest > 0.0 and (exact or largest * margin > 1.0):
        factor = 1.0 / (largest * margin)
    if process.form == "integrating" and factor < 1.0 and not exact:
        # A slower proportional action needs a slower integral, or the two integrators oscillate.
        integral_time /= factor
    return gain * factor / process.gain, integral_time, derivative_time
