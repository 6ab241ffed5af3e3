"""What a criterion hands back: one shape for all of them, in scaled units."""

from __future__ import annotations

from dataclasses import dataclass

from estimator._kernels import Array
from estimator.posterior import Posterior
from estimator.result import Interval, Process, RunnerUp
from loop_model import ProcessModel

__all__ = ["Estimate"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One criterion's answer.

    Attributes:
        criterion: ``"oe"`` or ``"arx"``.
        band, jump, static, dynamic: S, J, fS and fD as shares of OP's span.
        stem: scaled stem, shape ``(n,)``; simulated: scaled PV simulated from it.
        process: for the reader; model: the same in ARX form, in units of OP and PV.
        bic: of the one-step-ahead prediction errors (their noise whitened), comparable between
            criteria.
        posterior: the likelihood behind the intervals.
        runners_up: other process structures, best first.
    """

    criterion: str
    band: Interval
    jump: Interval
    static: Interval
    dynamic: Interval
    stem: Array
    simulated: Array
    process: Process
    model: ProcessModel
    bic: float
    posterior: Posterior
    runners_up: tuple[RunnerUp, ...]

    @staticmethod
    def intervals(posterior: Posterior, confidence: float) -> tuple[Interval, ...]:
        """S, J, fS and fD of a posterior; the values of fS and fD follow from those of S and J."""
        band, jump = posterior.nodes[:, 0], posterior.nodes[:, 1]
        s = posterior.interval(band, confidence)
        j = posterior.interval(jump, confidence)
        j = Interval(min(j.value, s.value), j.low, j.high)
        static = posterior.interval(0.5 * (band + jump), confidence)
        dynamic = posterior.interval(0.5 * (band - jump), confidence)
        return (
            s,
            j,
            static.around(0.5 * (s.value + j.value)),
            dynamic.around(0.5 * (s.value - j.value)),
        )
