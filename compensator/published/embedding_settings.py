"""What can be set of the stiction-embedding MPC."""

from __future__ import annotations

from dataclasses import dataclass, field

from compensator.action import (
    CompensatorError,
    OpLimits,
    require_not_negative,
    require_positive,
)
from compensator.hybrid.settings import HybridSettings

__all__ = ["EmbeddingSettings"]


@dataclass(frozen=True, slots=True)
class EmbeddingSettings:
    """Settings of `EmbeddingMpc`.

    Attributes:
        horizon: samples beyond the dead time, ``N_H`` of (16a).
        pv_weight: Q of (16a) on PV.
        op_weight: R of (16a), scaled as in `MpcSettings`.
        move_weight: price of the squared change of OP from sample to sample, scaled alike.
        tau: sharpness of (6); from 1e4 on the valve is He's exactly (the paper, section 2.1).
        limits: range and rate of OP.
        max_iterations: bound of IPOPT for each warm start.
        max_seconds: bound of IPOPT for each warm start, seconds of the wall clock.
        estimator: settings of the compensator that estimates and proposes the first warm start
            (its limits are replaced by ``limits``).
    """

    horizon: int = 40
    pv_weight: float = 1.0
    op_weight: float = 0.015
    move_weight: float = 0.0
    tau: float = 1e4
    limits: OpLimits = field(default_factory=OpLimits)
    max_iterations: int = 60
    max_seconds: float = 1.0
    estimator: HybridSettings = field(default_factory=HybridSettings)

    def __post_init__(self) -> None:
        if self.horizon < 2 or self.max_iterations < 1:
            raise CompensatorError(
                f"EmbeddingSettings: horizon must be at least 2 and max_iterations at least 1; got "
                f"{self.horizon} and {self.max_iterations}"
            )
        require_positive(
            "EmbeddingSettings",
            pv_weight=self.pv_weight,
            op_weight=self.op_weight,
            tau=self.tau,
            max_seconds=self.max_seconds,
        )
        require_not_negative("EmbeddingSettings", move_weight=self.move_weight)
