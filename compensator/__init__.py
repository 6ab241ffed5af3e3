"""Controllers on a loop model: parameters and measurements in, OP out."""

from compensator.action import Action, ActionStatus, CompensatorError, Controller, OpLimits
from compensator.pi import PiController, PiSettings
from compensator.prediction import NoiseModel, Prediction
from compensator.unaware import MpcSettings, UnawareMpc

__all__ = [
    "Action",
    "ActionStatus",
    "CompensatorError",
    "Controller",
    "MpcSettings",
    "NoiseModel",
    "OpLimits",
    "PiController",
    "PiSettings",
    "Prediction",
    "UnawareMpc",
]
