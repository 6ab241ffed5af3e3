"""The paper's criterion: one-step-ahead ARX prediction behind a valve, theta by least squares.

    window = ArxWindow.of(op, pv, ArxStructure(na=3, nb=3, dead_time=1))
    fit = window.fit(HeValve(11.0, 3.0), stem0=op[0])

Both of the paper's methods (`grid`, `nlp`) and comparisons with them evaluate a valve here, so
that costs are comparable: equation (12) over the samples for which every regressor of (13) exists.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.outcomes import EstimatorError
from estimator.valves import SlipStickValve
from loop_model import ProcessModel

__all__ = ["ArxStructure", "ArxWindow", "InitialStem", "PaperFit"]

Array = NDArray[np.float64]


class InitialStem(StrEnum):
    """The paper's two choices of the stem before the first sample (end of its section 5)."""

    FIRST = "first"
    MEAN = "mean"

    def position(self, op: Array) -> float:
        """The position, in units of OP."""
        return float(op[0]) if self is InitialStem.FIRST else float(op.mean())


@dataclass(frozen=True, slots=True)
class ArxStructure:
    """Orders of (7)-(8).

    Attributes:
        na, nb: coefficients on PV and on the stem.
        dead_time: samples from stem to PV; the paper's ``td`` plus one, and 0 is feed-through.
        intercept: estimate a constant too. The paper has none: its examples need none, and a real
            loop whose OP and PV are not deviations from a balance does.
    """

    na: int
    nb: int
    dead_time: int = 1
    intercept: bool = True

    def __post_init__(self) -> None:
        if self.na < 0 or self.nb < 1 or self.dead_time < 0:
            raise EstimatorError(
                "an ARX structure needs na >= 0, nb >= 1 and dead_time >= 0; got "
                f"na = {self.na}, nb = {self.nb}, dead_time = {self.dead_time}"
            )

    @property
    def lead(self) -> int:
        """Samples at the start of a window without complete regressors."""
        return max(self.na, self.nb + self.dead_time - 1)

    @property
    def coefficients(self) -> int:
        """Length of theta."""
        return self.na + self.nb + int(self.intercept)


@dataclass(frozen=True, slots=True)
class PaperFit:
    """A valve and a process found by the criterion of the paper.

    Attributes:
        valve: the valve model with its parameters.
        process: theta as a `ProcessModel`.
        cost: equation (12), half the sum of squared one-step-ahead errors, in units of PV squared.
        stem0: stem before the first sample.
        stem, pv_model: estimated stem and one-step-ahead PV, shape ``(n,)``; the first samples of
            ``pv_model``, which have no complete regressor, are NaN.
        evaluations: valves whose cost was computed on the way here.
    """

    valve: SlipStickValve
    process: ProcessModel
    cost: float
    stem0: float
    stem: Array
    pv_model: Array
    evaluations: int = 1

    @property
    def static_friction(self) -> float:
        """``fS``, in units of OP."""
        return self.valve.static_friction

    @property
    def dynamic_friction(self) -> float:
        """``fD``, in units of OP."""
        return self.valve.dynamic_friction


@dataclass(frozen=True, slots=True)
class ArxWindow:
    """A window prepared for many valves: the part of (13) that no valve changes is built once."""

    op: Array
    pv: Array
    structure: ArxStructure
    period: float
    past: Array
    target: Array

    @classmethod
    def of(
        cls, op: ArrayLike, pv: ArrayLike, structure: ArxStructure, *, period: float = 1.0
    ) -> ArxWindow:
        """Check a window (``op`` and ``pv`` of shape ``(n,)``, finite) and prepare it.

        Raises:
            EstimatorError: shapes differ, a sample is not finite, OP is constant, or there are
                fewer than three samples for each coefficient.
        """
        u = np.ascontiguousarray(op, dtype=np.float64)
        y = np.ascontiguousarray(pv, dtype=np.float64)
        if u.ndim != 1 or u.shape != y.shape:
            raise EstimatorError(
                f"op and pv must be vectors of one length; got shapes {u.shape} and {y.shape}"
            )
        for name, signal in (("op", u), ("pv", y)):
            bad = np.flatnonzero(~np.isfinite(signal))
            if bad.size:
                raise EstimatorError(
                    f"{name} is not finite in {bad.size} samples, first at {bad[0]}; the paper's "
                    f"methods need every sample: cut the window or use `identify`"
                )
        needed = structure.lead + 3 * (structure.coefficients + 2)
        if u.size < needed:
            raise EstimatorError(
                f"this ARX structure needs at least {needed} samples; the window has {u.size}"
            )
        if np.ptp(u) == 0.0:
            raise EstimatorError(
                "op is constant, so it shows nothing of the valve; give a window in which OP moves"
            )
        lead, n = structure.lead, u.size
        past = np.column_stack([-y[lead - i : n - i] for i in range(1, structure.na + 1)]).reshape(
            n - lead, structure.na
        )
        return cls(u, y, structure, float(period), past, y[lead:])

    @property
    def span(self) -> float:
        """Span of OP, the paper's ``fmax``."""
        return float(np.ptp(self.op))

    def regressors(self, stem: Array) -> Array:
        """Matrix of (13), one row for each sample with complete regressors."""
        s, n = self.structure, self.op.size
        blocks = [self.past]
        delayed = [stem[s.lead - s.dead_time - i : n - s.dead_time - i, None] for i in range(s.nb)]
        blocks.extend(delayed)
        if s.intercept:
            blocks.append(np.ones((n - s.lead, 1)))
        return np.hstack(blocks)

    def solve(self, stem: Array) -> tuple[Array, float]:
        """Theta and cost (12) for a given stem, by least squares as in (9)."""
        phi = self.regressors(stem)
        theta = np.asarray(np.linalg.lstsq(phi, self.target, rcond=None)[0], dtype=np.float64)
        error = self.target - phi @ theta
        return theta, 0.5 * float(error @ error)

    def process(self, theta: Array) -> ProcessModel:
        """Theta as a process model."""
        s = self.structure
        values = [float(value) for value in theta]
        return ProcessModel(
            a=tuple(values[: s.na]),
            b=tuple(values[s.na : s.na + s.nb]),
            dead_time=s.dead_time,
            offset=values[-1] if s.intercept else 0.0,
            period=self.period,
        )

    def fit(
        self,
        valve: SlipStickValve,
        stem0: float,
        *,
        theta: Array | None = None,
        evaluations: int = 1,
    ) -> PaperFit:
        """Evaluate a valve; ``theta`` fixes the process, otherwise least squares finds it."""
        stem = valve.simulate(self.op, stem0)
        if theta is None:
            theta = self.solve(stem)[0]
        model = np.full(self.op.size, math.nan)
        model[self.structure.lead :] = self.regressors(stem) @ theta
        error = self.target - model[self.structure.lead :]
        return PaperFit(
            valve=valve,
            process=self.process(theta),
            cost=0.5 * float(error @ error),
            stem0=float(stem0),
            stem=stem,
            pv_model=model,
            evaluations=evaluations,
        )
