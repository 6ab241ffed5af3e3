"""What `open_plant` would open, from the archive alone: nothing of it is run."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from .catalogue import plant_file
from .errors import PlantFileError
from .opening import OpenOptions, describe_fmu
from .plant import PlantInfo
from .ssp_components import extract_components, name_component, summarise_components
from .ssp_file import read_system
from .ssp_texts import leave_out_texts
from .start_values import StartValue
from .system_plant import system_info
from .system_values import SystemValues

__all__ = ["preview_plant"]

_NONE: Mapping[str, StartValue] = MappingProxyType({})


def preview_plant(
    model: str | Path, *, period: float, parameters: Mapping[str, StartValue] = _NONE
) -> PlantInfo:
    """Return what a plant is, and check the start values that it would get.

    Args:
        model: as `open_plant` takes it.
        period: seconds a step.
        parameters: start values, as `open_plant` takes them.

    Raises:
        PlantNameError, PlantInputError, PlantBuildError, PlantFileError: as `open_plant` does.
    """
    file = plant_file(model)
    if file.suffix == ".ssp":
        return _preview_system(file, period, parameters)
    return _preview_fmu(file, period, parameters)


def _preview_fmu(file: Path, period: float, parameters: Mapping[str, StartValue]) -> PlantInfo:
    described = describe_fmu(file, OpenOptions(parameters, period))
    described.variables.check_start(described.starts.numbers)
    return described.info


def _preview_system(file: Path, period: float, parameters: Mapping[str, StartValue]) -> PlantInfo:
    structure = read_system(file)
    with tempfile.TemporaryDirectory(prefix="fieldlink-ssp-") as folder:
        files = extract_components(file, structure.sources, Path(folder))
        leave_out_texts(structure, summarise_components(file, files))
        names = {*structure.inputs, *structure.parameters}
        own = {name: value for name, value in parameters.items() if name in names}
        inner = {name: value for name, value in parameters.items() if name not in names}
        given = SystemValues(structure, own).split(inner)
        infos = {}
        for component, fmu in files.items():
            try:
                infos[component] = _preview_fmu(fmu, period, given.get(component, _NONE))
            except PlantFileError as error:
                raise name_component(file, component, fmu, error) from error
    return system_info(structure, infos, period)
