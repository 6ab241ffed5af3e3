"""PV as the controller saw it: without its sensor's faults, beside the OP that answers it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Mask
from estimator.controller.reading import Controller, read_aligned
from estimator.faults import faults_of
from estimator.outcomes import Reason, ReasonCode
from estimator.settings import Screening
from estimator.window import Window

__all__ = ["Cleaned", "as_recorded", "clean", "screen_faults"]


@dataclass(frozen=True, slots=True)
class Cleaned:
    """PV ``(n,)`` as the controller saw it, NaN where it is bad.

    Attributes:
        pv: the samples.
        faults: which samples as recorded are faults of the sensor, ``(n,)``.
        late: samples by which PV was recorded later than OP.
        controller: what explains OP's moves to rounding; None where nothing does.
    """

    pv: Array
    faults: Mask
    late: int
    controller: Controller | None

    def tell(self) -> tuple[Reason, ...]:
        """What was left out, for a window that was judged; empty where nothing was."""
        if not self.faults.any():
            return ()
        return (Reason(ReasonCode.PV_FAULTS, f"{_words(self.faults)}: these are left out"),)

    def tell_late(self) -> tuple[str, ...]:
        """That PV was moved; empty where it was not."""
        if self.late == 0:
            return ()
        by = "1 sample" if self.late == 1 else f"{self.late} samples"
        return (
            f"PV is recorded {by} after the OP that answers it: it is judged as if {by} earlier",
        )


def clean(op: Array, pv: Array, sp: Array | None, settings: Screening) -> Cleaned:
    """PV without its sensor's faults, moved to the OP that answers it; ``(n,)`` each."""
    faults = faults_of(pv, settings)
    aligned = read_aligned(op, np.where(faults, math.nan, pv), sp)
    return Cleaned(aligned.pv, faults, aligned.late, aligned.controller)


def as_recorded(signal: Array, late: int) -> Array:
    """A signal ``(n,)`` that belongs to the moved PV, moved back; its first value is repeated."""
    return np.append(np.full(late, signal[0]), signal[: signal.size - late])


def screen_faults(window: Window, faults: Mask, settings: Screening) -> tuple[Reason, ...]:
    """Why a window without the ``faults`` ``(n,)`` cannot be judged; empty where it can."""
    left = int(window.good.sum())
    if not faults.any() or left >= (1.0 - settings.max_bad) * window.size:
        return ()
    text = (
        f"{_words(faults)}, which leaves {left} of {window.size} samples: "
        f"{1.0 - settings.max_bad:.0%} are needed"
    )
    return (Reason(ReasonCode.PV_FAULTS, text),)


def _words(faults: Mask) -> str:
    return f"PV jumps away and back, or stands still, in {int(faults.sum())} samples"
