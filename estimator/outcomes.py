"""What a window can turn out to be, and why: typed, each reason with its advice."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["EstimatorError", "Reason", "ReasonCode", "Verdict"]


class EstimatorError(ValueError):
    """The input is not a window of a loop: wrong shapes, wrong types, no usable number."""


class Verdict(StrEnum):
    """What the window says about the valve."""

    STICTION = "stiction"
    NO_STICTION = "no_stiction"
    NOT_ASSESSABLE = "not_assessable"


class ReasonCode(StrEnum):
    """Why a verdict is what it is; :attr:`advice` says what to do next."""

    STICKY_VALVE_EXPLAINS = "sticky_valve_explains"
    HEALTHY_VALVE_SUFFICES = "healthy_valve_suffices"
    DISTURBANCE_EXPLAINS = "disturbance_explains"
    TOO_FEW_SAMPLES = "too_few_samples"
    TOO_MANY_BAD_SAMPLES = "too_many_bad_samples"
    NOT_IN_AUTOMATIC = "not_in_automatic"
    OP_CONSTANT = "op_constant"
    OP_AT_LIMIT = "op_at_limit"
    OP_HARDLY_MOVES = "op_hardly_moves"
    PV_FROZEN = "pv_frozen"
    PV_FAULTS = "pv_faults"
    PV_AT_LIMIT = "pv_at_limit"
    NO_MODEL_EXPLAINS_PV = "no_model_explains_pv"
    TOO_FEW_MOVES = "too_few_moves"
    BAND_TOO_SMALL = "band_too_small"
    EVIDENCE_IN_ONE_PART = "evidence_in_one_part"
    RECORD_INTERPOLATED = "record_interpolated"
    UNCERTAIN = "uncertain"

    @property
    def advice(self) -> str:
        """What a technician can do about it (one sentence)."""
        return _ADVICE[self]


_ADVICE = {
    ReasonCode.STICKY_VALVE_EXPLAINS: "Check the packing, the positioner and the air supply.",
    ReasonCode.HEALTHY_VALVE_SUFFICES: "Nothing to do at the valve.",
    ReasonCode.DISTURBANCE_EXPLAINS: (
        "Look at the controller's tuning and for a disturbance that comes from outside the loop; "
        "judge the valve by further windows."
    ),
    ReasonCode.TOO_FEW_SAMPLES: "Record a longer window, 500 samples or more.",
    ReasonCode.TOO_MANY_BAD_SAMPLES: "Repair the signal or its recording, then record again.",
    ReasonCode.NOT_IN_AUTOMATIC: "Record while the controller is in automatic.",
    ReasonCode.OP_CONSTANT: "Record while OP moves: in automatic, or with small steps of OP.",
    ReasonCode.OP_AT_LIMIT: "Record while OP is inside its range.",
    ReasonCode.OP_HARDLY_MOVES: "Record a longer window or one with a set-point change.",
    ReasonCode.PV_FROZEN: "Check the transmitter and the recording of PV.",
    ReasonCode.PV_FAULTS: "Check the transmitter, its wiring and the recording of PV.",
    ReasonCode.PV_AT_LIMIT: "Record while PV is inside the transmitter's range.",
    ReasonCode.NO_MODEL_EXPLAINS_PV: (
        "PV does not follow OP in this window: look for disturbances, or record with small steps."
    ),
    ReasonCode.TOO_FEW_MOVES: "Record a longer window or one with a set-point change.",
    ReasonCode.BAND_TOO_SMALL: "Nothing to do at the valve; watch whether the band grows.",
    ReasonCode.EVIDENCE_IN_ONE_PART: (
        "Look for a jump of the load or a gap in that part; judge another window."
    ),
    ReasonCode.RECORD_INTERPOLATED: (
        "Poll the loop: the historian has drawn straight lines where the evidence was."
    ),
    ReasonCode.UNCERTAIN: "Judge a longer window, one polled faster, or one with a set-point step.",
}


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason: its code and the sentence with the figures of this window."""

    code: ReasonCode
    text: str

    @property
    def advice(self) -> str:
        """What to do about it."""
        return self.code.advice

    def __str__(self) -> str:
        return self.text
