"""The simulated Modbus PLC that hosts plants, their controllers and a compensator.

Importing this package makes ``link = "fmu"`` known to `fieldlink.links.open_link`.
"""

from fieldlink.links import register_link
from fieldlink.plc.build import LoopSetup, PlcError
from fieldlink.plc.control import ControlledLoop
from fieldlink.plc.listening import Listening, PortError
from fieldlink.plc.lockstep import LockstepLink
from fieldlink.plc.plants import HostedPlant
from fieldlink.plc.program import Commands, LoopFailedError, LoopProgram
from fieldlink.plc.server import PlcServer, serve
from fieldlink.plc.truth import CycleRecord, Truth
from fieldlink.plc.virtual import VirtualPlc

__all__ = [
    "Commands",
    "ControlledLoop",
    "CycleRecord",
    "HostedPlant",
    "Listening",
    "LockstepLink",
    "LoopFailedError",
    "LoopProgram",
    "LoopSetup",
    "PlcError",
    "PlcServer",
    "PortError",
    "Truth",
    "VirtualPlc",
    "serve",
]

register_link("fmu", LockstepLink)
