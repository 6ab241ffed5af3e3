"""Take the FMUs of a system out of its archive, and describe them."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from .errors import PlantFileError
from .fmu_summary import summarise_fmu
from .summary import FmuSummary

__all__ = ["extract_components", "name_component", "summarise_components"]


def extract_components(file: Path, sources: Mapping[str, str], folder: Path) -> dict[str, Path]:
    """Extract the FMU of every component of an SSP archive; return their paths by component.

    Raises:
        PlantFileError: one of them is not in the archive.
    """
    found: dict[str, Path] = {}
    with zipfile.ZipFile(file) as archive:
        for number, (component, source) in enumerate(sources.items()):
            target = folder / f"{number}" / Path(source).name
            target.parent.mkdir()
            try:
                target.write_bytes(archive.read(source))
            except KeyError as error:
                raise PlantFileError(
                    f"{file}: {component}: its FMU {source} is not in the archive"
                ) from error
            found[component] = target
    return found


def summarise_components(file: Path, components: Mapping[str, Path]) -> dict[str, FmuSummary]:
    """Describe the extracted FMU of every component of the system ``file``.

    Raises:
        PlantFileError: one of them cannot be read; the component is named.
    """
    parts: dict[str, FmuSummary] = {}
    for component, fmu in components.items():
        try:
            parts[component] = summarise_fmu(fmu)
        except PlantFileError as error:
            raise name_component(file, component, fmu, error) from error
    return parts


def name_component(file: Path, component: str, fmu: Path, error: PlantFileError) -> PlantFileError:
    """Return the error of an extracted FMU as one of its component in the system ``file``."""
    text = str(error).removeprefix(f"{fmu}: ").removeprefix(f"{fmu.resolve()}: ")
    return PlantFileError(f"{file}: {component}: {fmu.name}: {text}")
