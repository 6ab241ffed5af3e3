"""The valve model and the process model: what the estimator finds and the compensator uses.

Both packages read this module and nothing of each other. It holds values and the equations that
define them, no algorithms.

Sign and time conventions, used everywhere:

* ``x_k`` is the stem position during sample ``k``, in units of OP; ``y_k`` is PV at sample ``k``.
* ``dead_time`` counts samples from stem to PV: ``y_k`` depends on ``x_(k-dead_time)`` and older.
  Zero is direct feed-through; the paper's ``td = 0`` (its equation (10), a sampled process without
  additional delay) is ``dead_time = 1``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LoopModel", "ProcessModel", "ValveModel"]


@dataclass(frozen=True, slots=True)
class ValveModel:
    """He's two-parameter valve: He et al., 2007; (3)-(4) of Bacci di Capaci et al., 2018.

    The pair is held as stick band ``S = fS + fD`` and slip jump ``J = fS - fD`` because these are
    what the data determine separately; ``0 <= J <= S`` is the paper's triangle ``fS >= fD >= 0``.
    Units: those of OP.
    """

    stick_band: float
    slip_jump: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.stick_band) and 0.0 <= self.slip_jump <= self.stick_band):
            raise ValueError(
                f"a valve needs 0 <= slip jump <= stick band, both finite; got "
                f"slip_jump={self.slip_jump!r}, stick_band={self.stick_band!r}"
            )

    @classmethod
    def from_friction(cls, static: float, dynamic: float) -> ValveModel:
        """Build from static and dynamic friction ``fS >= fD >= 0`` (units of OP)."""
        return cls(stick_band=static + dynamic, slip_jump=static - dynamic)

    @property
    def static_friction(self) -> float:
        """``fS = (S + J) / 2``."""
        return 0.5 * (self.stick_band + self.slip_jump)

    @property
    def dynamic_friction(self) -> float:
        """``fD = (S - J) / 2``."""
        return 0.5 * (self.stick_band - self.slip_jump)

    def step(self, stem: float, op: float) -> float:
        """Return the stem position after one sample, equation (4)."""
        error = op - stem
        if error > self.static_friction:
            return op - self.dynamic_friction
        if error < -self.static_friction:
            return op + self.dynamic_friction
        return stem

    def simulate(self, op: ArrayLike, stem0: float) -> NDArray[np.float64]:
        """Return the stem ``(n,)`` for every sample of ``op``; ``stem0`` is before the first."""
        signal = np.asarray(op, dtype=np.float64)
        stem = np.empty_like(signal)
        position = stem0
        for k, value in enumerate(signal):
            position = self.step(position, float(value))
            stem[k] = position
        return stem


@dataclass(frozen=True, slots=True)
class ProcessModel:
    """A sampled linear process in ARX form, equations (7)-(8) with an intercept.

    ``y_k = -a1 y_(k-1) - ... + b1 x_(k-d) + b2 x_(k-d-1) + ... + offset`` with ``d = dead_time``.

    Attributes:
        a: ``(a1, ..., a_na)``, the leading 1 left out.
        b: ``(b1, ..., b_nb)``.
        dead_time: samples from stem to PV, zero or more (the paper's ``td`` plus one).
        offset: intercept, in units of PV.
        period: sampling period in seconds.
    """

    a: tuple[float, ...]
    b: tuple[float, ...]
    dead_time: int
    offset: float
    period: float

    def __post_init__(self) -> None:
        numbers = (*self.a, *self.b, self.offset, self.period)
        if not self.b or not all(map(math.isfinite, numbers)):
            raise ValueError(
                "a process needs at least one b and finite numbers; got "
                f"a = {self.a}, b = {self.b}, offset = {self.offset}, period = {self.period}"
            )
        if self.dead_time < 0 or self.period <= 0.0:
            raise ValueError(
                "dead_time must not be negative and period must be positive; got "
                f"dead_time = {self.dead_time}, period = {self.period}"
            )

    @property
    def is_integrating(self) -> bool:
        """Whether a pole lies at 1, to within rounding of double precision.

        A third-order process sampled a hundred times faster than its lags has ``A(1)`` near 1e-6.
        """
        return abs(1.0 + math.fsum(self.a)) < 1e-10 * (1.0 + math.fsum(map(abs, self.a)))

    @property
    def gain(self) -> float:
        """Steady-state gain ``B(1)/A(1)`` in PV per OP; infinite (signed) when integrating."""
        if self.is_integrating:
            return math.copysign(math.inf, math.fsum(self.b))
        return math.fsum(self.b) / (1.0 + math.fsum(self.a))

    def as_controlled(self) -> ProcessModel:
        """Return the process as a controller meets it, which reads PV before it moves OP.

        In a record PV may be stored after OP, so that a sample of PV holds part of what the stem
        did in it (dead time 0). For a controller that part comes with the next sample's: the
        first two coefficients act together, one sample after OP. Gain and lags stay the same. A
        lag that is sampled at any point between two moves of OP becomes itself, exactly.
        """
        if self.dead_time > 0:
            return self
        first, *others = self.b
        b = (first + others[0], *others[1:]) if others else (first,)
        return replace(self, b=b, dead_time=1)

    def simulate(
        self, stem: ArrayLike, *, pv0: ArrayLike = (), noise: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Return PV for every sample of ``stem`` (shape ``(n,)``).

        Before the first sample the stem stood at ``stem[0]``. ``pv0`` holds the PV before the first
        sample, oldest first; what is missing of it is the steady state (zero when integrating).
        ``noise`` (shape ``(n,)``) is the equation noise ``v_k`` of (7).
        """
        x = np.asarray(stem, dtype=np.float64)
        na, nb = len(self.a), len(self.b)
        past = np.asarray(pv0, dtype=np.float64)
        rest = 0.0
        if not self.is_integrating:
            rest = (math.fsum(self.b) * float(x[0]) + self.offset) / (1.0 + math.fsum(self.a))
        y = np.full(na + x.size, rest)
        kept = min(na, past.size)
        if kept:
            y[na - kept : na] = past[past.size - kept :]
        lead = self.dead_time + nb - 1
        padded = np.concatenate([np.full(lead, x[0]), x])
        v = np.zeros(x.size) if noise is None else np.asarray(noise, dtype=np.float64)
        for k in range(x.size):
            total = self.offset + v[k]
            for i, coefficient in enumerate(self.a):
                total -= coefficient * y[na + k - 1 - i]
            for i, coefficient in enumerate(self.b):
                total += coefficient * padded[k + nb - 1 - i]
            y[na + k] = total
        return y[na:]


@dataclass(frozen=True, slots=True)
class LoopModel:
    """A sticky valve in front of a process: the Hammerstein model of Figure 1 of the paper."""

    valve: ValveModel
    process: ProcessModel
