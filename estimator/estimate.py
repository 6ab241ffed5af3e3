"""What a criterion hands back: one shape for all of them, in scaled units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator._kernels import Array
from estimator.candidate import Candidate
from estimator.posterior import Peak, Posterior
from estimator.result import Interval, Process, RunnerUp
from loop_model import ProcessModel

__all__ = ["MISFIT", "Estimate"]

MISFIT = 0.08, 0.35
"""Standard deviations of S and J, as shares of S, where one-step errors follow the slips: He's law
is then not quite that of the valve. A valve that goes on with OP after a slip has a J near zero in
his law, whatever it jumped. The size of the errors in `benchmarks.robustness`."""


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
        peaks: valves that explain the window about equally well, as shares of OP's span.
        runners_up: other process structures, best first.
        simulating: the valve with the low-order process that simulates PV from it, where that is
            the criterion's.
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
    runners_up: tuple[RunnerUp, ...]
    peaks: tuple[Peak, ...] = ()
    simulating: Candidate | None = None

    @staticmethod
    def intervals(
        posterior: Posterior, confidence: float, blur: tuple[float, float], band: float, jump: float
    ) -> tuple[Interval, ...]:
        """S, J, fS and fD of a posterior for the valve (``band``, ``jump``) of the estimate.

        ``blur`` are standard deviations of S and J beside the likelihood, for the model's valve
        slips at a sample and a real one between two. The values are those of one valve: valve and
        process must be of one piece.
        """
        s = posterior.interval(1.0, 0.0, confidence, blur[0]).within(0.0).around(band)
        j = posterior.interval(0.0, 1.0, confidence, blur[1]).within(0.0, s.high)
        j = j.around(min(jump, s.value))
        both = 0.5 * math.hypot(*blur)
        static = posterior.interval(0.5, 0.5, confidence, both).within(0.0)
        dynamic = posterior.interval(0.5, -0.5, confidence, both).within(0.0)
        return (
            s,
            j,
            static.around(0.5 * (s.value + j.value)),
            dynamic.around(0.5 * (s.value - j.value)),
        )
