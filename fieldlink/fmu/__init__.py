"""Anybody's FMU: map its variables to tags, run it, sweep it, begin one of your own."""

from fieldlink.fmu.errors import FmuError
from fieldlink.fmu.mapping import FmuMap, load_map
from fieldlink.fmu.recorder import RunResult, write_table
from fieldlink.fmu.runner import RunSettings, run_fmu
from fieldlink.fmu.units import Conversion, conversion

__all__ = [
    "Conversion",
    "FmuError",
    "FmuMap",
    "RunResult",
    "RunSettings",
    "conversion",
    "load_map",
    "run_fmu",
    "write_table",
]
