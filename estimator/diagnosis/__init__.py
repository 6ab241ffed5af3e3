"""Why a loop swings and which loop started it: arrays in, a diagnosis out. No file, no wire.

found = diagnose(op, pv, sp, period=1.0)
found.first.name, found.first.evidence, found.first.action
"""

from estimator.controller.controller import Controller
from estimator.controller.reading import read_controller
from estimator.diagnosis.coherence import LoopSignals
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.groups import Group, find_groups
from estimator.diagnosis.oscillation import Oscillation, detect_oscillation
from estimator.diagnosis.result import Cause, CauseName, Diagnosis
from estimator.diagnosis.warming import warm_up

__all__ = [
    "Cause",
    "CauseName",
    "Controller",
    "Diagnosis",
    "Group",
    "LoopSignals",
    "Oscillation",
    "detect_oscillation",
    "diagnose",
    "find_groups",
    "read_controller",
    "warm_up",
]
