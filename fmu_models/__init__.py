"""Plants as FMUs: sources, build, catalogue, stepping.

No controller study and no PLC: those are in `fieldlink.lab`.
"""

from .catalogue import CatalogueModel, LoopVariables, catalogue, fmu_path
from .errors import (
    PlantBuildError,
    PlantClosedError,
    PlantCrashError,
    PlantEndedError,
    PlantError,
    PlantFileError,
    PlantInputError,
    PlantNameError,
    PlantStepError,
    PlantTimeoutError,
)
from .plant import Piece, Plant, PlantInfo
from .preview import preview_plant
from .ssp_export import RunExport, export_run
from .ssp_structure import Master
from .start_values import StartValue
from .stepping import open_plant
from .summarising import summarise
from .summary import FmuSummary, UnitDefinition, VariableSummary
from .sweep import Sweep, SweepRun, run_sweep
from .windows import collect_windows

__all__ = [
    "CatalogueModel",
    "FmuSummary",
    "LoopVariables",
    "Master",
    "Piece",
    "Plant",
    "PlantBuildError",
    "PlantClosedError",
    "PlantCrashError",
    "PlantEndedError",
    "PlantError",
    "PlantFileError",
    "PlantInfo",
    "PlantInputError",
    "PlantNameError",
    "PlantStepError",
    "PlantTimeoutError",
    "RunExport",
    "StartValue",
    "Sweep",
    "SweepRun",
    "UnitDefinition",
    "VariableSummary",
    "catalogue",
    "collect_windows",
    "export_run",
    "fmu_path",
    "open_plant",
    "preview_plant",
    "run_sweep",
    "summarise",
]
