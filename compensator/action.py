"""What all controllers share: their action, its status and the limits of OP.

A controller gets OP and PV from `Controller.observe` (once a scan, in control or not) and returns
the next OP from `Controller.decide`. Because it has seen the whole history of OP and PV, under
every controller, it can take over at any scan without a bump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

__all__ = [
    "Action",
    "ActionStatus",
    "CompensatorError",
    "Controller",
    "OpLimits",
    "RefusalKind",
    "as_measured",
]


class RefusalKind(Enum):
    """Why a model is not used; the value is the explanation."""

    NONE = "nothing is refused"
    WRONG_SIGN = "the sign of the gain is not that of the loop's own controller"
    UNSTABLE = "the process model is unstable"
    PERIOD = "the model's sampling period is not that of the scans"
    RANGE = "a parameter is outside what the controller accepts"
    WORSE = "given up: PV got worse, or hardly better"
    TRAVEL = "given up: the valve's travel was over its budget"
    LEFT_RANGE = "given up: the error left the range that was known of it"
    OTHER = "withdrawn by an operator or for another reason"


class CompensatorError(ValueError):
    """A setting, a model or a measurement that a controller cannot work with.

    Args:
        message: what was found, and what to do.
        kind: of the refusal, where a model is refused.
    """

    def __init__(self, message: str, kind: RefusalKind = RefusalKind.RANGE) -> None:
        super().__init__(message)
        self.kind = kind


class ActionStatus(Enum):
    """How an action came about; the value is the advice for the reader."""

    OPTIMAL = "the computed optimum is applied"
    HOLDING = "the valve is held where it is, no move pays for itself"
    MOVING = "the valve is being moved along the computed plan"
    LIMITED = "the set-point cannot be reached inside the OP range; the nearest point is aimed at"
    SOLVER_FAILED = "the solver passed its bound; OP is held, look at limits and weights"
    PV_BAD = "PV is not a number; OP is held until it comes back"
    NOT_READY = "nothing was observed yet; call observe() once a scan"

    @property
    def advice(self) -> str:
        """The sentence to show to an operator."""
        return self.value


@dataclass(frozen=True, slots=True)
class Action:
    """One control decision.

    Attributes:
        op: the OP to apply until the next scan, inside the limits.
        status: how it came about.
        target: steady OP (or stem position) that the controller is heading for; NaN if unknown.
        predicted_pv: PV expected at the end of the horizon under the plan; NaN if unknown.
        stem: stem position expected after this OP; NaN when the controller has no valve model.
        detail: a few words on the plan, for displays and logs.
    """

    op: float
    status: ActionStatus
    target: float = math.nan
    predicted_pv: float = math.nan
    stem: float = math.nan
    detail: str = ""


class Controller(Protocol):
    """A controller of one loop; see the module's text for the two calls of a scan."""

    def observe(self, pv: float, op: float) -> None:
        """Take in PV measured now (NaN when bad) and the OP applied since the last scan."""

    def decide(self, sp: float) -> Action:
        """Return the OP to apply until the next scan for the set-point ``sp``."""


@dataclass(frozen=True, slots=True)
class OpLimits:
    """Range of OP and the largest change of it from one scan to the next (units of OP)."""

    low: float = 0.0
    high: float = 100.0
    rate: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise CompensatorError(
                f"OP limits need low < high, both finite; got low={self.low!r}, high={self.high!r}"
            )
        if not self.rate > 0.0:
            raise CompensatorError(
                f"the OP rate limit must be positive (math.inf for none); got {self.rate!r}"
            )

    def holds(self, op: float, beyond: float) -> bool:
        """Return whether ``op`` is inside the range, or beyond it by at most that share of it."""
        margin = beyond * (self.high - self.low)
        return self.low - margin <= op <= self.high + margin

    def clip(self, op: float, previous: float) -> float:
        """Return ``op`` moved inside the range and the rate seen from ``previous``."""
        inside = min(max(op, self.low), self.high)
        return min(max(inside, previous - self.rate), previous + self.rate)


_LARGEST_PV = 3.4028235e38
"""Largest number of a register of 32 bits; squares of it are numbers still."""


def as_measured(pv: float) -> float:
    """Return PV, NaN where no register can have held it."""
    return pv if abs(pv) <= _LARGEST_PV else math.nan


def require_positive(where: str, **values: float) -> None:
    """Raise `CompensatorError` naming the first of ``values`` that is not positive and finite."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise CompensatorError(f"{where}: {name} must be positive and finite; got {value!r}")


def require_not_negative(where: str, **values: float) -> None:
    """Raise `CompensatorError` naming the first of ``values`` that is negative or not finite."""
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise CompensatorError(
                f"{where}: {name} must not be negative and must be finite; got {value!r}"
            )


def require_whole(where: str, least: int, **values: float) -> None:
    """Raise `CompensatorError` naming the first of ``values`` that is not a whole number from
    ``least`` on.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value == int(value) and value >= least):
            raise CompensatorError(
                f"{where}: {name} must be a whole number of at least {least}; got {value!r}"
            )


def require_finite(where: str, **values: float) -> None:
    """Raise `CompensatorError` naming the first of ``values`` that is not finite."""
    for name, value in values.items():
        if not math.isfinite(value):
            raise CompensatorError(f"{where}: {name} must be a finite number; got {value!r}")
