"""Between blocks and a supervisor: what a block states, and why its model is refused."""

from __future__ import annotations

from statistics import NormalDist

from compensator import RefusalKind, Supervisor, Uncertainty
from fieldlink.registers import Bounded, ParameterBlock, Refusal

__all__ = ["refusal_of", "uncertainty_of"]


def uncertainty_of(block: ParameterBlock) -> Uncertainty:
    """Return the standard deviations of the friction that a block's bounds state.

    The bounds are taken as those of a normal distribution at the block's confidence.
    """
    if not 0.0 < block.confidence < 1.0:
        return Uncertainty()
    deviations = 2.0 * NormalDist().inv_cdf(0.5 + 0.5 * block.confidence)

    def deviation(bounded: Bounded) -> float:
        return max(0.0, bounded.high - bounded.low) / deviations

    return Uncertainty(deviation(block.static_friction), deviation(block.dynamic_friction))


def refusal_of(supervisor: Supervisor) -> Refusal | None:
    """Return why a supervisor does not use the model offered last; None if it does."""
    kind = supervisor.refused
    return None if kind is RefusalKind.NONE else Refusal[kind.name]
