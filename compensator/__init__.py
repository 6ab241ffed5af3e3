"""Controllers on a loop model: parameters and measurements in, OP out."""

from compensator.action import Action, ActionStatus, CompensatorError, Controller, OpLimits
from compensator.embedding import EmbeddingMpc, EmbeddingSettings
from compensator.followed import Followed
from compensator.hybrid import HybridMpc, HybridSettings
from compensator.knocker import Knocker, KnockerSettings
from compensator.moves import warm_up
from compensator.pi import PiController, PiSettings
from compensator.prediction import NoiseModel, Prediction
from compensator.supervisor import (
    Compensator,
    Supervisor,
    SupervisorSettings,
    SupervisorState,
    WithdrawReason,
)
from compensator.two_move import TwoMove, TwoMoveSettings
from compensator.unaware import MpcSettings, UnawareMpc

__all__ = [
    "Action",
    "ActionStatus",
    "Compensator",
    "CompensatorError",
    "Controller",
    "EmbeddingMpc",
    "EmbeddingSettings",
    "Followed",
    "HybridMpc",
    "HybridSettings",
    "Knocker",
    "KnockerSettings",
    "MpcSettings",
    "NoiseModel",
    "OpLimits",
    "PiController",
    "PiSettings",
    "Prediction",
    "Supervisor",
    "SupervisorSettings",
    "SupervisorState",
    "TwoMove",
    "TwoMoveSettings",
    "UnawareMpc",
    "WithdrawReason",
    "warm_up",
]
