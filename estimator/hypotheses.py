"""Sticky against healthy valve, and against a disturbance from outside: the tests themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator._slips import Op
from estimator.arx import ArxOrders
from estimator.arx_search import ArxFound
from estimator.candidate import Candidate
from estimator.noise import effective_samples
from estimator.outside import Outside
from estimator.regression import Regression
from estimator.verdict import simulated_evidence
from estimator.whitened import whitened_bic

__all__ = ["OneStepTest", "against_outside", "healthy_bic", "one_step_test", "simulated_test"]


def simulated_test(
    op: Op, regression: Regression, best: Candidate, healthy: Candidate
) -> tuple[float, float]:
    """Log Bayes factor from simulation errors, and the effective samples it counts."""
    samples = min(
        effective_samples(
            regression.solve(stem, c.structure, c.dead_time).residual, regression.weight
        )
        for stem, c in ((best.stem(op), best), (op.u, healthy))
    )
    return simulated_evidence(healthy.cost, best.cost, samples), samples


def against_outside(op: Op, regression: Regression, best: Candidate, outside: Outside) -> float:
    """Log Bayes factor of a sticky valve over a sinusoid, from simulation errors.

    Both have three parameters more than a healthy valve alone.
    """
    rival = outside.process
    samples = min(
        effective_samples(r.solve(stem, c.structure, c.dead_time).residual, r.weight)
        for r, stem, c in (
            (regression, best.stem(op), best),
            (outside.regression, op.u, rival),
        )
    )
    return 0.5 * samples * math.log(rival.cost / best.cost)


@dataclass(frozen=True, slots=True)
class OneStepTest:
    """Sticky against healthy valve by one-step errors: the best noise model of each.

    All figures are BIC per sample, because criteria lose a few samples each at the start of the
    window: ``oe`` of the whitened simulation model (infinite where no valve simulates PV), ``arx``
    of the one-step criterion, ``healthy`` of the better of both with a healthy valve. ``count`` is
    the number of samples.
    """

    oe: float
    arx: float
    healthy: float
    count: float

    @property
    def sticky(self) -> float:
        """BIC per sample of the better noise model."""
        return min(self.oe, self.arx)

    @property
    def evidence(self) -> float:
        """Log Bayes factor of a sticky over a healthy valve."""
        return 0.5 * self.count * (self.healthy - self.sticky)

    @property
    def ahead(self) -> float:
        """BIC per sample by which the one-step criterion is the better one."""
        return self.oe - self.arx

    def against(self, outside: Outside, op: Op) -> float:
        """Log Bayes factor of a sticky valve over a healthy one and a sinusoid."""
        bic = whitened_bic(op, outside.regression, outside.process, healthy=True)
        return 0.5 * (bic - self.count * self.sticky)


def one_step_test(
    op: Op,
    regression: Regression,
    best: Candidate,
    arx: ArxFound,
    healthy: float,
    simulated: float,
) -> OneStepTest:
    """The test with the valves of both criteria; ``healthy`` is what :func:`healthy_bic` returns.

    ``simulated`` is the log Bayes factor of ``best``, which is looked at where it speaks for it.
    """
    oe = math.inf
    if simulated > 0.0:
        oe = whitened_bic(op, regression, best, healthy=False) / regression.count
    return OneStepTest(oe, arx.bic_per_sample, healthy, regression.count)


def healthy_bic(op: Op, regression: Regression, healthy: Candidate, orders: ArxOrders) -> float:
    """BIC per sample of the one-step errors with a healthy valve: the better noise model's.

    ``orders`` are the best ones of an ARX model with OP in place of the stem.
    """
    whitened = whitened_bic(op, regression, healthy, healthy=True)
    return min(orders.bic / orders.rows, whitened / regression.count)
