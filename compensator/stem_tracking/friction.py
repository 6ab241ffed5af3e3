"""What is believed of a valve's friction before any command has tested it.

The parameters of a block are known to some per cent only. The static friction is taken as normal
around fS; one valve in twenty is worse described than its parameters say. The prior does not fade
with the evidence: a hypothesis that claims more friction than fS pays for the claim as long as it
makes it, and a claim beyond `FrictionPrior.farthest` deviations is impossible. Otherwise every
correction that misses would be answered by a larger one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError, require_not_negative
from compensator.stem_tracking.hypothesis_kernels import (
    DOUBT,
    DOUBTFUL,
    FARTHEST,
    KEPT,
    NEAREST,
    NEGLIGIBLE,
)
from loop_model import ValveModel

__all__ = ["FrictionPrior", "Uncertainty"]


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard deviations of the friction that an identification states.

    Attributes:
        static_friction: of fS, in OP; 0 when nothing is stated.
        dynamic_friction: of fD, in OP; 0 when nothing is stated.
    """

    static_friction: float = 0.0
    dynamic_friction: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(
            "Uncertainty",
            static_friction=self.static_friction,
            dynamic_friction=self.dynamic_friction,
        )


@dataclass(frozen=True, slots=True)
class FrictionPrior:
    """Prior of the friction around a valve model.

    Attributes:
        spread: least relative deviation of fS: friction varies by some per cent from slip to slip
            and with the stem's position (Karnopp, 1985; recorded valves), whatever an
            identification states.
        dynamic_spread: least relative deviation of fD. It is wider than that of fS because fD
            follows from S and J as a difference, and J is the less certain of the two (Table 1 of
            Bacci di Capaci et al., 2018).
        doubt: share of valves that their parameters describe badly.
        doubtful: factor of their deviation.
        nearest: deviations from fS (negative: below it) up to which a command never moves the stem.
        farthest: deviations above fS from which a command always does; the bound of every claim.
        kept: share of a claim that is left after each slip, because friction varies.
        jump_spread_most: largest relative deviation of J, and with it of the gain, that one tracker
            counts with; what is stated beyond it is for trackers of other slip jumps
            (`TrackerSettings.jumps`).
        uncertainty: deviations that the identification states; the larger ones count.
    """

    spread: float = 0.1
    dynamic_spread: float = 0.25
    doubt: float = 0.05
    doubtful: float = 4.0
    nearest: float = -4.0
    farthest: float = 6.0
    kept: float = 0.95
    jump_spread_most: float = 0.3
    uncertainty: Uncertainty = Uncertainty()

    def __post_init__(self) -> None:
        require_not_negative(
            "FrictionPrior", spread=self.spread, dynamic_spread=self.dynamic_spread
        )
        if not (0.0 <= self.doubt < 1.0 and 0.0 <= self.kept <= 1.0 and self.doubtful >= 1.0):
            raise CompensatorError(
                f"FrictionPrior: doubt and kept are shares and doubtful is a factor of at least 1; "
                f"got {self.doubt!r}, {self.kept!r} and {self.doubtful!r}"
            )
        if not self.nearest < 0.0 < self.farthest:
            raise CompensatorError(
                f"FrictionPrior: nearest must be below 0 and farthest above it; got "
                f"{self.nearest!r} and {self.farthest!r}"
            )

    def static_deviation(self, valve: ValveModel) -> float:
        """Return the deviation of fS, in OP."""
        stated = self.uncertainty.static_friction
        return max(self.spread * valve.static_friction, stated, 1e-12)

    def dynamic_deviation(self, valve: ValveModel) -> float:
        """Return the deviation of fD, in OP."""
        return max(self.dynamic_spread * valve.dynamic_friction, self.uncertainty.dynamic_friction)

    def jump_deviation(self, valve: ValveModel) -> float:
        """Return the relative deviation of J that the identification states, at most
        `jump_spread_most`.

        The stick band is known well, so that it is twice that of fD.
        """
        return min(self._stated_jump_deviation(valve), self.jump_spread_most)

    def price_of_jump(self, valve: ValveModel, factor: float) -> float:
        """Return the log-odds of the stated J over ``factor`` times it; infinite where nothing
        uncertain is stated.
        """
        deviation = self._stated_jump_deviation(valve)
        return 0.5 * ((factor - 1.0) / deviation) ** 2 if deviation > 0.0 else math.inf

    def _stated_jump_deviation(self, valve: ValveModel) -> float:
        if valve.slip_jump <= 0.0:
            return 0.0
        return 2.0 * self.uncertainty.dynamic_friction / valve.slip_jump

    def error_covariance(self, valve: ValveModel, gain_spread: float) -> NDArray[np.float64]:
        """Return the covariance of the error of fD (OP) and of the relative error of the gain.

        A limit cycle at one set-point shows what a slip makes of PV, so that a slip jump which is
        too small by a share comes with a gain too large by as much, and with half of it in fD.

        Args:
            valve: the valve model.
            gain_spread: relative deviation that the gain has beside that.
        """
        jump = self.jump_deviation(valve)
        shared = np.array([0.5 * valve.slip_jump * jump, -jump])
        alone = max(self.dynamic_deviation(valve) ** 2 - float(shared[0]) ** 2, 0.0)
        return np.diag([alone, gain_spread**2]) + np.outer(shared, shared)

    def law(self, negligible: float) -> NDArray[np.float64]:
        """Return what compiled loops need of it, and the chance below which an outcome counts for
        nothing: see `hypothesis_kernels`.
        """
        law = np.empty(NEGLIGIBLE + 1)
        law[NEAREST], law[FARTHEST] = self.nearest, self.farthest
        law[DOUBT], law[DOUBTFUL] = self.doubt, self.doubtful
        law[KEPT], law[NEGLIGIBLE] = self.kept, negligible
        return law
