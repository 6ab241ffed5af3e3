"""The process as a state space with an offset-free disturbance, and the filter that tracks it.

The ARX model is written in observer form, so that the first state *is* the noise-free PV and the
equation noise of (7) enters through a known gain:

    xi_(k+1) = A xi_k + B (x_k + m_k) + K v_k,    y_k = xi_k[0] + p_k + v_k + w_k

with ``A = [-a | I]``, ``B`` the coefficients b behind the dead time, ``K = -a``. The disturbance
that makes the controller offset-free is a random walk, either ``p`` on the output (the paper's
``d`` in (16d)) or ``m`` at the input: a process with a pole at 1 cannot tell an output disturbance
from its own state, so it always gets the one at the input.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError, RefusalKind, require_not_negative
from compensator.kernels import next_state, process_answer, step_response_of
from compensator.riccati import solve_riccati
from loop_model import ProcessModel

__all__ = [
    "LONGEST_DEAD_TIME",
    "Disturbance",
    "NoiseModel",
    "Prediction",
    "StateFilter",
    "answer_of",
    "as_designed",
]

Disturbance = Literal["auto", "output", "input"]
Array = NDArray[np.float64]

LONGEST_DEAD_TIME = 200
"""Samples of dead time: each is a state, and the covariance's update grows with their square."""
_FASTEST_WITHIN = 400
"""Samples after the dead time within which a process answers fastest."""
_REMEMBERED = 8
"""Predictions whose settling time is known: every tracker of a bank asks for the same few."""
_DESIGNED_BITS = 27
"""Of a design's gains: eight digits; BLAS differs between processors from the twelfth on."""


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Relative standard deviations that set the filter's gain; only their ratios matter.

    Attributes:
        equation: of ``v`` in (7), which passes through the process.
        measurement: of white noise added to PV alone.
        disturbance: of the step per sample of the offset-free disturbance, in PV (an input
            disturbance is scaled to PV by the process).
    """

    equation: float
    measurement: float
    disturbance: float

    def __post_init__(self) -> None:
        require_not_negative(
            "NoiseModel",
            equation=self.equation,
            measurement=self.measurement,
            disturbance=self.disturbance,
        )
        if self.disturbance == 0.0 or self.equation + self.measurement == 0.0:
            raise CompensatorError(
                "NoiseModel: disturbance and one of equation and measurement must be above zero, "
                "otherwise the filter never corrects an offset"
            )


@dataclass(frozen=True, eq=False)
class Prediction:
    """State space of a `ProcessModel` in observer form.

    Attributes:
        A: shape ``(n, n)``; B: shape ``(n,)``; PV is the first state (plus an output disturbance).
        input_disturbance: whether the disturbance enters with the stem instead of on PV.
        rest: disturbance of a loop at rest: the model's intercept.
        equation_gain: shape ``(n,)``, how equation noise enters.
        dead_time: samples from a change of OP to PV, at least 1.
    """

    process: ProcessModel
    A: Array
    B: Array
    input_disturbance: bool
    rest: float
    equation_gain: Array
    dead_time: int

    @classmethod
    def of(cls, process: ProcessModel, disturbance: Disturbance = "auto") -> Prediction:
        """Build the state space.

        A dead time of 0 (PV and OP of one record recorded after each other) becomes one of 1:
        `ProcessModel.as_controlled`.

        Raises:
            CompensatorError: a process that controls nothing (zero gain), is unstable, or is
                integrating with an output disturbance asked for.
        """
        process = process.as_controlled()
        dead_time = process.dead_time
        if dead_time > LONGEST_DEAD_TIME:
            raise CompensatorError(
                f"a dead time of {dead_time} samples is longer than the {LONGEST_DEAD_TIME} that "
                "can be controlled; identify with a longer sampling period"
            )
        na, nb = len(process.a), len(process.b)
        n = max(na, dead_time + nb - 1)
        b = np.zeros(n)
        b[dead_time - 1 : dead_time - 1 + nb] = process.b
        a = np.zeros(n)
        a[:na] = process.a
        A = np.eye(n, k=1)
        A[:, 0] = -a
        integrating = process.is_integrating
        poles = np.abs(np.roots(np.concatenate([[1.0], process.a])))
        if integrating:  # the pole at 1 itself is known to single precision only
            poles = np.delete(poles, int(np.argmin(np.abs(poles - 1.0))))
        if poles.size and float(poles.max()) >= 1.0:
            raise CompensatorError(
                f"the process model is unstable (largest pole {float(poles.max()):.6g}); identify "
                f"it again or correct a={process.a}",
                RefusalKind.UNSTABLE,
            )
        if abs(math.fsum(process.b)) <= 1e-12 * math.fsum(map(abs, process.b)) or not any(
            process.b
        ):
            raise CompensatorError(f"the process model has no steady gain: b={process.b}")
        if integrating and disturbance == "output":
            raise CompensatorError(
                "an integrating process needs an input disturbance: an output disturbance cannot "
                "be told from its state; use disturbance='auto'"
            )
        at_input = integrating or disturbance == "input"
        rest = process.offset / math.fsum(process.b) if at_input else 0.0
        if not at_input:
            rest = process.offset / (1.0 + math.fsum(process.a))
        return cls(process, A, b, at_input, rest, -a, dead_time)

    @property
    def order(self) -> int:
        """Number of states."""
        return self.B.size

    @cached_property
    def scale(self) -> float:
        """PV that a lasting change of OP by one makes: the gain, or when integrating what has
        come up 20 samples after the dead time.
        """
        if not self.process.is_integrating:
            return abs(self.process.gain)
        return float(np.abs(self.step_response(self.dead_time + 20)).max())

    @cached_property
    def fastest(self) -> float:
        """Largest change of PV within one scan that a step of OP by one makes."""
        impulse = np.zeros(_FASTEST_WITHIN)
        impulse[0] = 1.0
        return float(np.abs(answer_of(self.process, impulse)).max())

    def equilibrium(self, pv: float, disturbance: float) -> tuple[Array, float]:
        """Return the state (shape ``(n,)``) and the input at which PV rests at ``pv``."""
        state, drive = self._rest_at_one
        level = pv if self.input_disturbance else pv - disturbance
        at_input = disturbance if self.input_disturbance else 0.0
        return level * state, level * drive - at_input

    @cached_property
    def _rest_at_one(self) -> tuple[Array, float]:
        """State and input at which the process rests at 1."""
        p, n = self.process, self.order
        drive = (1.0 + math.fsum(p.a)) / math.fsum(p.b)
        state = np.zeros(n)
        after = 0.0
        for i in range(n - 1, 0, -1):
            after = state[i] = self.A[i, 0] + self.B[i] * drive + after
        state[0] = 1.0
        return state, drive

    def step_response(self, samples: int) -> Array:
        """Return PV at 1, 2, ... ``samples`` samples after a unit step of the stem."""
        return step_response_of(self.A, self.B, samples)

    def filter_gain(self, noise: NoiseModel) -> tuple[Array, Array, float]:
        """Return the steady Kalman gain of the state (``(n,)``), of the disturbance, and the
        innovation's variance in the units of ``noise``.

        The equation noise of one sample is in PV of that sample and in the next state, so process
        and measurement noise are correlated (the cross term of the Riccati equation).
        """
        n = self.order
        A = np.zeros((n + 1, n + 1))
        A[:n, :n] = self.A
        A[n, n] = 1.0
        c = np.zeros(n + 1)
        c[0] = 1.0
        scale = 1.0
        if self.input_disturbance:
            A[:n, n] = self.B
            scale = 1.0 / abs(float(self.B.sum()))
        else:
            c[n] = 1.0
        enters = np.concatenate([self.equation_gain, [0.0]])
        q = noise.equation**2 * np.outer(enters, enters)
        q[n, n] += (noise.disturbance * scale) ** 2
        r = noise.equation**2 + noise.measurement**2 + 1e-9
        cross = noise.equation**2 * enters
        try:
            covariance = solve_riccati(A.T, c, q, r, cross)
        except CompensatorError as error:
            raise CompensatorError(
                f"no Kalman filter exists for this process and noise model ({error}); the "
                f"disturbance cannot be observed in PV; identify the process again"
            ) from error
        innovation = float(c @ covariance @ c) + r
        gain = as_designed((A @ covariance @ c + cross) / innovation)
        return gain[:n], gain[n:], innovation


def as_designed(gains: Array) -> Array:
    """Return a design's gains to eight digits of the largest.

    Equations are solved by the machine's BLAS, whose last digits are those of its processor. While
    a valve sticks, what a controller makes of such a digit grows from scan to scan, until the next
    slip comes at another sample. A gain is known to three digits at best.
    """
    largest = float(np.abs(gains).max())
    if largest == 0.0 or not math.isfinite(largest):
        return gains
    step = math.ldexp(1.0, math.frexp(largest)[1] - _DESIGNED_BITS)  # exact: a power of two
    rounded: Array = np.ascontiguousarray(np.round(gains / step) * step)
    return rounded


def answer_of(process: ProcessModel, drive: Array, late: int = 0) -> Array:
    """Return what a process makes of a drive (shape ``(n,)``) from rest, ``late`` samples later.

    Its own dead time is left out.
    """
    delayed = np.concatenate([np.zeros(late), drive])[: drive.size]
    return process_answer(np.array(process.b), np.array(process.a), delayed)


@lru_cache(maxsize=_REMEMBERED)
def settling_samples(prediction: Prediction, most: int = 2000) -> int:
    """Return samples after which a step's effect (its slope, when integrating) stays within 2 %."""
    response = prediction.step_response(most)
    if prediction.process.is_integrating:
        response = np.diff(response, prepend=0.0)
    outside = np.flatnonzero(np.abs(response - response[-1]) > 0.02 * abs(response[-1]))
    return int(outside[-1]) + 2 if outside.size else 1


class StateFilter:
    """Kalman filter of a `Prediction` in predictor form: state and disturbance *at the next PV*.

    `update` moves on by one scan. The predictor form is exact for equation noise: the part of PV
    that the noise of this very sample made is carried on with the process, not taken for an offset.
    """

    def __init__(self, prediction: Prediction, noise: NoiseModel) -> None:
        self.prediction = prediction
        self._gain, gain, self._variance = prediction.filter_gain(noise)
        self._gain_disturbance = float(gain[0])
        self.state = np.zeros(prediction.order)
        self.disturbance = prediction.rest
        self.ready = False
        self._last_innovation = 0.0

    def start(self, pv: float, stem: float) -> None:
        """Assume rest at ``pv`` with the stem at ``stem``: the disturbance explains the gap."""
        p = self.prediction
        if p.input_disturbance:
            self.state, drive = p.equilibrium(pv, 0.0)
            self.disturbance = drive - stem
        else:
            gain = p.process.gain
            self.state, _ = p.equilibrium(gain * stem, 0.0)
            self.disturbance = pv - gain * stem
        self._last_innovation = 0.0
        self.ready = True

    def correct(self, pv: float) -> float:
        """Take in PV of this scan (NaN: none) and return the innovation (NaN: none).

        The noise of this sample is known from here on, so `advance` carries it into the next state.
        """
        if not np.isfinite(pv):
            self._last_innovation = 0.0
            return float("nan")
        self._last_innovation = float(pv) - self.pv
        return self._last_innovation

    def advance(self, stem: float) -> None:
        """Move to the next scan with the stem (or OP) at ``stem`` until then."""
        self.state, self.disturbance = self.free()
        self.state = self.state + self.prediction.B * stem
        self._last_innovation = 0.0

    def free(self) -> tuple[Array, float]:
        """Return state (``(n,)``) and disturbance of the next scan as they would be at stem 0.

        Add ``B * stem`` for any other stem. Nothing is changed.
        """
        p = self.prediction
        state = next_state(p.A, self.state) + self._gain * self._last_innovation
        if p.input_disturbance:
            state = state + p.B * self.disturbance
        return state, self.disturbance + self._gain_disturbance * self._last_innovation

    @property
    def pv(self) -> float:
        """PV expected at this scan before it is measured."""
        output = 0.0 if self.prediction.input_disturbance else self.disturbance
        return float(self.state[0]) + output
