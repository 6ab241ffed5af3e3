"""What a criterion or a published method hands back: one shape for all of them."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.arrays import Array
from estimator.intervals.posterior import Peak
from estimator.result import Interval, Process
from loop_model import ProcessModel

__all__ = ["Estimate"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One answer.

    Attributes:
        criterion: its name.
        reason: why the estimate is under this criterion, one sentence.
        band, jump, static, dynamic: S, J, fS and fD as shares of OP's span.
        stem: scaled stem, ``(n,)``; simulated: scaled PV simulated from it.
        process: for the reader; model: the same in ARX form, in units of OP and PV.
        peaks: valves that explain the window about equally well, as shares of OP's span.
        varies: standard deviation of S from slip to slip, as a share of OP's span; 0 under a law.
    """

    criterion: str
    reason: str
    band: Interval
    jump: Interval
    static: Interval
    dynamic: Interval
    stem: Array
    simulated: Array
    process: Process
    model: ProcessModel
    peaks: tuple[Peak, ...] = ()
    varies: float = 0.0
