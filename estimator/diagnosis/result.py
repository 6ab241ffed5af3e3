"""What a diagnosis says: immutable, with its evidence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from estimator.controller.controller import Controller
from estimator.diagnosis.oscillation import Oscillation

__all__ = ["Cause", "CauseName", "Diagnosis", "plain"]


class CauseName(StrEnum):
    """Why a loop is as it is; :attr:`action` says what to do next."""

    STICKY_VALVE = "sticky_valve"
    EXTERNAL_OSCILLATION = "external_oscillation"
    TIGHT_TUNING = "tight_tuning"
    SLOW_TUNING = "slow_tuning"
    SATURATION = "saturation"
    CHARACTERISTIC = "characteristic"
    SENSOR = "sensor"
    MANUAL = "manual"
    QUIET = "quiet"
    UNDETERMINED = "undetermined"

    @property
    def action(self) -> str:
        """What to do about it (one or two sentences)."""
        return _ACTIONS[self]

    @property
    def words(self) -> str:
        """The cause for a reader."""
        return self.value.replace("_", " ")


_ACTIONS = {
    CauseName.STICKY_VALVE: (
        "Check the packing, the positioner and the air supply; retuning does not cure it."
    ),
    CauseName.EXTERNAL_OSCILLATION: (
        "Look for a loop or machine that swings with the same period; diagnose the neighbours of "
        "the same hours together."
    ),
    CauseName.TIGHT_TUNING: "Lower the controller's gain; see the proposed settings, if any.",
    CauseName.SLOW_TUNING: (
        "Tune the controller faster; see the proposed settings, if any. A level that is meant to "
        "average the flows through its vessel is right as it is."
    ),
    CauseName.SATURATION: (
        "Check the size of the valve, its limits in the controller, and what the loop is asked for."
    ),
    CauseName.CHARACTERISTIC: (
        "Linearise: correct the characteristic in the positioner or schedule the gain over OP; "
        "until then tune for the range of the highest gain."
    ),
    CauseName.SENSOR: "Check the transmitter, its filter, its range and the resolution of PV.",
    CauseName.MANUAL: "Ask why the loop is in manual; put it in automatic and diagnose again.",
    CauseName.QUIET: "Nothing to do.",
    CauseName.UNDETERMINED: (
        "Record longer and faster, with a set-point step of some times the noise; or put the loop "
        "in manual for a few periods: an oscillation that stays comes from outside."
    ),
}


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause: its weight (share of what the loop suffers, 0 to 1), what speaks for it, and what
    to do about it: what its name advises unless given.
    """

    name: CauseName
    weight: float
    evidence: tuple[str, ...]
    action: str = ""

    def __post_init__(self) -> None:
        """Give a cause without an action of its own what its name advises."""
        if not self.action:
            object.__setattr__(self, "action", self.name.action)

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "name": self.name.value,
            "weight": self.weight,
            "evidence": list(self.evidence),
            "action": self.action,
        }


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Why a loop swings, or how well it runs.

    Attributes:
        causes: the heaviest first; never empty.
        oscillation: the main one.
        oscillating: the signal in which it was found: ``"error"``, ``"pv"`` or ``"op"``.
        indices: figures by name; the unit is the end of the name. NaN where there is none.
        controller: the running controller, None where it cannot be read.
        tuning: advice, None where there is none; see `estimator.diagnosis.tuning`.
        samples, period_s: of the record.
        notes: what limits this diagnosis, in sentences.
    """

    causes: tuple[Cause, ...]
    oscillation: Oscillation
    oscillating: str
    indices: Mapping[str, float]
    controller: Controller | None
    tuning: Mapping[str, Any] | None
    samples: int
    period_s: float
    notes: tuple[str, ...] = field(default=())

    @property
    def first(self) -> Cause:
        """The heaviest cause."""
        return self.causes[0]

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of ``fieldlink diagnose --json``: plain types, null for no number."""
        swing = self.oscillation
        return {
            "causes": [cause.to_dict() for cause in self.causes],
            "oscillation": {
                "present": swing.present,
                "period_s": plain(swing.period_s),
                "regularity": plain(swing.regularity),
                "amplitude": plain(swing.amplitude),
                "cycles": plain(swing.cycles),
                "signal": self.oscillating,
            },
            "indices": {name: plain(value) for name, value in self.indices.items()},
            "controller": None if self.controller is None else self.controller.to_dict(),
            "tuning": None if self.tuning is None else plain(self.tuning),
            "samples": self.samples,
            "period_s": self.period_s,
            "notes": list(self.notes),
        }


def plain(value: Any) -> Any:
    """The value for JSON, which has no NaN and no infinity: null."""
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(part) for part in value]
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, int):
        return value
    number = float(value)
    return number if math.isfinite(number) else None
