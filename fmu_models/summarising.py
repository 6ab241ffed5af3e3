"""Describe a file, be it an FMU or a system of FMUs."""

from __future__ import annotations

from pathlib import Path

from .fmu_summary import summarise_fmu
from .summary import FmuSummary
from .system_summary import summarise_system

__all__ = ["summarise"]


def summarise(file: Path) -> FmuSummary:
    """Describe an FMU, or a system of FMUs (``.ssp``), without running anything of it.

    Raises:
        PlantFileError: no such file, not a zip, too large, no model description that can be read.
    """
    return summarise_system(file) if file.suffix == ".ssp" else summarise_fmu(file)
