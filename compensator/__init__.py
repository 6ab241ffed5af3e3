"""Controllers on a loop model: parameters and measurements in, OP out."""

from compensator.action import Action, ActionStatus, CompensatorError, Controller, OpLimits
from compensator.hybrid import HybridMpc, HybridSettings
from compensator.moves import warm_up
from compensator.pi import PiController, PiSettings
from compensator.prediction import NoiseModel, Prediction
from compensator.supervisor import (
    Supervisor,
    SupervisorSettings,
    SupervisorState,
    WithdrawReason,
)
from compensator.unaware import MpcSettings, UnawareMpc

__all__ = [
    "Action",
    "ActionStatus",
    "CompensatorError",
    "Controller",
    "HybridMpc",
    "HybridSettings",
    "MpcSettings",
    "NoiseModel",
    "OpLimits",
    "PiController",
    "PiSettings",
    "Prediction",
    "Supervisor",
    "SupervisorSettings",
    "SupervisorState",
    "UnawareMpc",
    "WithdrawReason",
    "warm_up",
]
