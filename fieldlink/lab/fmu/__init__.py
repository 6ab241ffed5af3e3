"""Anybody's FMU: map its variables to tags, run it, sweep it, begin one of your own.

Loading and stepping an FMU is `fmu_models`; serving it as a PLC is `fieldlink.lab.plc`.
"""

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.exporting import export_system
from fieldlink.lab.fmu.mapping import FmuMap, load_map
from fieldlink.lab.fmu.recorder import RunResult, TableFile
from fieldlink.lab.fmu.run_settings import RunSettings
from fieldlink.lab.fmu.runner import run_fmu
from fieldlink.lab.fmu.units import Conversion, conversion

__all__ = [
    "Conversion",
    "FmuError",
    "FmuMap",
    "RunResult",
    "RunSettings",
    "TableFile",
    "conversion",
    "export_system",
    "load_map",
    "run_fmu",
]
