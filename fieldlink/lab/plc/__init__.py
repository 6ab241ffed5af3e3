"""The simulated Modbus PLC that hosts plants, their controllers and a compensator.

Importing this package makes ``link = "fmu"`` known to `fieldlink.links.open_link`.
"""

from fieldlink.lab.plc.batched import BatchedPlc
from fieldlink.lab.plc.build import LoopSetup, PlcError
from fieldlink.lab.plc.checking import check_plants
from fieldlink.lab.plc.control import ControlledLoop
from fieldlink.lab.plc.listening import Listening, PortError
from fieldlink.lab.plc.lockstep import LockstepLink
from fieldlink.lab.plc.plants import HostedPlant
from fieldlink.lab.plc.program import Commands, LoopFailedError, LoopProgram
from fieldlink.lab.plc.server import PlcServer, serve
from fieldlink.lab.plc.truth import CycleRecord, Truth
from fieldlink.lab.plc.virtual import VirtualPlc
from fieldlink.links import register_link

__all__ = [
    "BatchedPlc",
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
    "check_plants",
    "serve",
]

register_link("fmu", LockstepLink)
