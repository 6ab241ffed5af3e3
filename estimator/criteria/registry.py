"""The criteria by name. A further one is one file with these two methods, and one line here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol

from estimator.criteria.likelihood import likelihood_estimate
from estimator.criteria.one_step import arx_estimate
from estimator.estimate import Estimate
from estimator.evidence.weighing import Weighing
from estimator.hypotheses.hypothesis import Case
from estimator.settings import Modelling
from estimator.window import Window

__all__ = ["CRITERIA", "Criterion", "Request"]


@dataclass(frozen=True, slots=True)
class Request:
    """What the caller asked of one window, and what the record says of itself.

    ``sign`` is that of the process gain, 0 where it is unknown; ``informed`` the share of samples
    that were measured, ``left_out`` the step that a historian left out, as a share of the span;
    ``soonest`` the least dead time that a process may have, in samples.
    """

    criterion: str
    confidence: float
    method: str
    surface: bool
    sign: float
    informed: float
    left_out: float = 0.0
    soonest: int = 0


class Criterion(Protocol):
    """What makes a valve and a process good."""

    def modelling(self, settings: Modelling) -> Modelling:
        """The noise that both hypotheses may have under this criterion."""
        ...

    def estimate(
        self, case: Case, window: Window, weighing: Weighing, confidence: float
    ) -> Estimate:
        """Valve, process and intervals."""
        ...


class ColouredNoise:
    """``auto``: simulation with autoregressive noise; BIC chooses its order, zero included."""

    def modelling(self, settings: Modelling) -> Modelling:
        """As it is."""
        return settings

    def estimate(
        self, case: Case, window: Window, weighing: Weighing, confidence: float
    ) -> Estimate:
        """The likeliest valve."""
        order = weighing.best.taps.size
        reason = (
            f"the noise is autoregressive of order {order}" if order else "the noise is white"
        ) + ", by BIC"
        return likelihood_estimate(case, window, weighing, confidence, "oe", reason)


class WhiteNoise:
    """``oe``: simulation with white noise, the plain simulation error."""

    def modelling(self, settings: Modelling) -> Modelling:
        """White noise only."""
        return replace(settings, noise_orders=(0,))

    def estimate(
        self, case: Case, window: Window, weighing: Weighing, confidence: float
    ) -> Estimate:
        """The likeliest valve."""
        return likelihood_estimate(case, window, weighing, confidence, "oe", "as asked")


class OneStepAhead:
    """``arx``: one-step-ahead errors, the paper's (12)."""

    def modelling(self, settings: Modelling) -> Modelling:
        """As it is: the verdict rests on the same evidence."""
        return settings

    def estimate(
        self, case: Case, window: Window, weighing: Weighing, confidence: float
    ) -> Estimate:
        """The valve of the least one-step-ahead errors near the likeliest one."""
        assert weighing.sticky is not None
        return arx_estimate(case, window, weighing.sticky, confidence, "as asked")


CRITERIA: MappingProxyType[str, Criterion] = MappingProxyType(
    {"auto": ColouredNoise(), "oe": WhiteNoise(), "arx": OneStepAhead()}
)
"""Criteria that :func:`estimator.identify` knows."""
