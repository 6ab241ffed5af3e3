"""What a criterion hands back: one shape for all of them, in scaled units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array
from estimator.posterior import Posterior
from estimator.result import Interval, Process, RunnerUp
from loop_model import ProcessModel

__all__ = ["Estimate"]

_BLUR = 0.1


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
    runners_up: tuple[RunnerUp, ...]

    @staticmethod
    def intervals(posterior: Posterior, confidence: float, op: Array) -> tuple[Interval, ...]:
        """S, J, fS and fD of a posterior; the values of fS and fD follow from those of S and J.

        The model's valve slips at a sample, a real one between two: no threshold is known better
        than a fraction of what OP (``op``, scaled, shape ``(n,)``) moves from sample to sample.
        """
        band, jump = posterior.nodes[:, 0], posterior.nodes[:, 1]
        steps = np.abs(np.diff(op))
        blur = _BLUR * float(np.median(steps[steps > 0.0]))
        # The values are those of the most likely node: valve and process must be of one piece.
        top = posterior.best
        s = posterior.interval(band, confidence, blur).within(0.0).around(float(top[0]))
        j = posterior.interval(jump, confidence, blur).within(0.0, s.high).around(float(top[1]))
        j = Interval(min(j.value, s.value), j.low, j.high)
        static = posterior.interval(0.5 * (band + jump), confidence, blur).within(0.0)
        dynamic = posterior.interval(0.5 * (band - jump), confidence, blur).within(0.0)
        return (
            s,
            j,
            static.around(0.5 * (s.value + j.value)),
            dynamic.around(0.5 * (s.value - j.value)),
        )
