"""What every valve model shares: its two parameters, its state, and the checks of both."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loop_model import ValveModel

__all__ = ["SlipStickValve", "ValveState"]


class ValveState(NamedTuple):
    """Everything a valve remembers from one sample to the next.

    He's models use ``stem`` alone; Kano's and Choudhury's need the rest.

    Attributes:
        stem: position of the stem, in units of OP.
        op: the OP of the sample before.
        trend: sign of the last change of OP (-1, 0 or 1).
        direction: direction of the stem's last travel (-1 or 1).
        moving: whether the stem followed OP in the sample before.
        paused: whether it came to rest because OP stopped, not because it turned (Choudhury).
        rest_op: OP from which the band is counted while the stem rests.
    """

    stem: float
    op: float
    trend: float
    direction: float
    moving: bool
    paused: bool
    rest_op: float


@dataclass(frozen=True, slots=True)
class SlipStickValve(ABC):
    """Base of the valve models: ``0 <= slip_jump <= stick_band``, in units of OP.

    Raises:
        ValueError: when the pair lies outside the triangle or is not finite.
    """

    stick_band: float
    slip_jump: float

    def __post_init__(self) -> None:
        ValveModel(self.stick_band, self.slip_jump)

    @property
    def static_friction(self) -> float:
        """``fS = (S + J) / 2``, in units of OP."""
        return 0.5 * (self.stick_band + self.slip_jump)

    @property
    def dynamic_friction(self) -> float:
        """``fD = (S - J) / 2``, in units of OP."""
        return 0.5 * (self.stick_band - self.slip_jump)

    @classmethod
    def from_friction(cls, static: float, dynamic: float) -> Self:
        """Build from ``fS >= fD >= 0``; further parameters keep their defaults."""
        return cls(stick_band=static + dynamic, slip_jump=static - dynamic)

    def start(self, op: float, stem: float) -> ValveState:
        """State of a valve at rest at ``stem`` while the controller output is ``op``."""
        return ValveState(stem, op, 0.0, 1.0, False, False, stem + self.dynamic_friction)

    @abstractmethod
    def step(self, state: ValveState, op: float) -> ValveState:
        """Return the state after one sample with controller output ``op``."""

    @abstractmethod
    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        """Stem of every sample of a checked signal."""

    def simulate(self, op: ArrayLike, stem0: float | None = None) -> NDArray[np.float64]:
        """Return the stem for every sample of ``op`` (shape ``(n,)``, finite, units of OP).

        ``stem0`` is the position before the first sample (default: the first OP).

        Raises:
            ValueError: ``op`` is empty, not one-dimensional or not finite.
        """
        signal = np.ascontiguousarray(op, dtype=np.float64)
        if signal.ndim != 1 or signal.size == 0:
            raise ValueError(f"op must be a non-empty vector; got shape {signal.shape}")
        if not np.isfinite(signal).all():
            first = int(np.flatnonzero(~np.isfinite(signal))[0])
            raise ValueError(
                f"op must be finite, but sample {first} is {signal[first]}; "
                f"fill or cut bad samples before simulating a valve"
            )
        stem = float(signal[0]) if stem0 is None else float(stem0)
        if not math.isfinite(stem):
            raise ValueError(f"stem0 must be finite; got {stem0!r}")
        return self._run(signal, self.start(float(signal[0]), stem))
