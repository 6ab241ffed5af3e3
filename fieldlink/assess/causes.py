"""Why a loop swings, and the next step: the columns ``cause`` and ``action``.

The one place where they are decided. The names are those of ``fieldlink diagnose``, which is asked
where the valve is not the cause; what stays open is ``undetermined``, with what would determine it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from estimator import ReasonCode, Verdict

if TYPE_CHECKING:
    from estimator import Identification
    from fieldlink.assess.series import Series

__all__ = ["Cause", "cause_of"]

STICKY, UNDETERMINED = "sticky_valve", "undetermined"

_CAUSES = {
    ReasonCode.NOT_IN_AUTOMATIC: "manual",
    ReasonCode.OP_AT_LIMIT: "saturation",
    ReasonCode.PV_FROZEN: "sensor",
    ReasonCode.PV_FAULTS: "sensor",
    ReasonCode.PV_AT_LIMIT: "sensor",
}


@dataclass(frozen=True, slots=True)
class Cause:
    """A cause's name and what to do about it, one sentence."""

    name: str
    action: str


def cause_of(result: Identification, window: Series) -> Cause:
    """Return the first cause of a window and the next step.

    Args:
        result: the verdict with its reasons.
        window: its samples, for a diagnosis that looks at more than the valve.
    """
    from fieldlink.diagnosis import diagnose

    reason = result.reasons[0]
    if result.verdict is Verdict.STICTION:
        doubt = [one for one in result.reasons if one.code is ReasonCode.UNCERTAIN]
        return Cause(UNDETERMINED if doubt else STICKY, (doubt or [reason])[0].advice)
    if reason.code in _CAUSES:
        return Cause(_CAUSES[reason.code], reason.advice)
    if result.verdict is Verdict.NOT_ASSESSABLE:
        return Cause(UNDETERMINED, reason.advice)
    # One word on the valve: the verdict of this row. So a sticky one is not searched again.
    found = diagnose(
        window.op,
        window.pv,
        window.sp,
        auto=window.auto,
        period=window.period,
        advice=False,
        figures=False,
        valve_is_healthy=True,
    ).causes[0]
    return Cause(found.name.value, found.action or found.name.action)
