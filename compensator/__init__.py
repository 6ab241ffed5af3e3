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
from compensator.conventional.pi import PiController, PiSettings
from compensator.conventional.unaware import MpcSettings, UnawareMpc
from compensator.hybrid.controller import HybridMpc
from compensator.hybrid.moves import warm_up
from compensator.hybrid.settings import HybridSettings
from compensator.prediction import NoiseModel, Prediction
from compensator.published.embedding import EmbeddingMpc, EmbeddingSettings
from compensator.published.knocker import Knocker, KnockerSettings
from compensator.published.two_move import TwoMove, TwoMoveSettings
from compensator.stem_tracking.friction import Uncertainty
from compensator.supervising.figures import LoopFigures
from compensator.supervising.followed import Followed
from compensator.supervising.given_up import GivenUp, RetrySettings
from compensator.supervising.supervision import (
    Compensator,
    LoopMemory,
    SupervisorSettings,
    SupervisorState,
    WithdrawReason,
)
from compensator.supervising.supervisor import Supervisor
from compensator.supervising.watch_settings import WatchSettings

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
