"""Controllers on a loop model: parameters and measurements in, OP out.

No file, socket or clock, and no identification: a model comes in from outside.
"""

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    Controller,
    OpLimits,
    RefusalKind,
)
from compensator.embedding import EmbeddingMpc, EmbeddingSettings
from compensator.figures import LoopFigures
from compensator.followed import Followed
from compensator.friction import Uncertainty
from compensator.given_up import GivenUp, RetrySettings
from compensator.hybrid import HybridMpc
from compensator.hybrid_settings import HybridSettings
from compensator.knocker import Knocker, KnockerSettings
from compensator.moves import warm_up
from compensator.pi import PiController, PiSettings
from compensator.prediction import NoiseModel, Prediction
from compensator.supervision import (
    Compensator,
    LoopMemory,
    SupervisorSettings,
    SupervisorState,
    WithdrawReason,
)
from compensator.supervisor import Supervisor
from compensator.two_move import TwoMove, TwoMoveSettings
from compensator.unaware import MpcSettings, UnawareMpc
from compensator.watch_settings import WatchSettings

__all__ = [
    "Action",
    "ActionStatus",
    "Compensator",
    "CompensatorError",
    "Controller",
    "EmbeddingMpc",
    "EmbeddingSettings",
    "Followed",
    "GivenUp",
    "HybridMpc",
    "HybridSettings",
    "Knocker",
    "KnockerSettings",
    "LoopFigures",
    "LoopMemory",
    "MpcSettings",
    "NoiseModel",
    "OpLimits",
    "PiController",
    "PiSettings",
    "Prediction",
    "RefusalKind",
    "RetrySettings",
    "Supervisor",
    "SupervisorSettings",
    "SupervisorState",
    "TwoMove",
    "TwoMoveSettings",
    "UnawareMpc",
    "Uncertainty",
    "WatchSettings",
    "WithdrawReason",
    "warm_up",
]
