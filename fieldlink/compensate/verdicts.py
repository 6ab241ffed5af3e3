"""What came of the OP of one scan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Step", "Verdict", "with_verdict"]


class Verdict(Enum):
    """The outcome of the OP of one scan; the value is the advice."""

    WRITTEN = "OP was written"
    DRY_RUN = "OP would be written; ask for --write to do it"
    NOT_ENABLED = "the site file does not enable it; set enabled = true in the table compensate"
    PLC_DISABLED = "the PLC's enable bit is 0: the operator does not allow it"
    MANUAL = "the loop is in manual"
    NO_MODEL = "no block is in force: the PLC's own controller has the loop"
    WAITING = "the PLC's own controller has the loop; see the reason"
    NOT_READ = "OP, PV or SP could not be read: nothing is computed from old values"
    WRITE_FAILED = "the PLC did not confirm the write; the PLC's time-out decides"


@dataclass(frozen=True, slots=True)
class Step:
    """One scan: what was read, computed, and done.

    Attributes:
        verdict: the outcome of ``op``.
        pv, sp, op_before: as read, NaN where that failed.
        op: computed; NaN when nothing was.
        detail: the compensator's or the link's words.
    """

    verdict: Verdict
    pv: float
    sp: float
    op_before: float
    op: float
    detail: str


def with_verdict(step: Step, verdict: Verdict, detail: str | None = None) -> Step:
    """Return a step with another verdict, and with other words where they are given."""
    words = step.detail if detail is None else detail
    return Step(verdict, step.pv, step.sp, step.op_before, step.op, words)
