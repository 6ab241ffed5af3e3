"""Start values of a component, in the numbers and units that its FMU takes."""

from __future__ import annotations

from .errors import PlantFileError, PlantInputError
from .ssp_structure import SystemStructure
from .ssp_values import SiUnit
from .start_values import StartValue
from .summary import FmuSummary

__all__ = ["resolve_starts"]


def resolve_starts(
    structure: SystemStructure, component: str, fmu: FmuSummary
) -> tuple[dict[str, StartValue], list[str]]:
    """Return a component's start values by variable, and the names that its FMU does not have.

    SSP 1.0 has names without a variable ignored; the reader of the second list tells the user.

    Raises:
        PlantFileError: a value that does not fit its variable.
    """
    found: dict[str, StartValue] = {}
    ignored = []
    for name, start in structure.starts.get(component, {}).items():
        variable = fmu.variable(name)
        if variable is None:
            ignored.append(f"{component}.{name}")
            continue
        unit = structure.unit_of.get((component, name)) or _own_unit(fmu, variable.unit)
        items = {item: float(value) for value, item in variable.items}
        try:
            text = variable.type == "String"
            found[name] = start.text() if text else start.number(unit, items)
        except PlantInputError as error:
            raise PlantFileError(f"{structure.file}: {component}.{name}: {error}") from error
    return found, ignored


def _own_unit(fmu: FmuSummary, name: str) -> SiUnit | None:
    """Return a unit as the FMU defines it."""
    for unit in fmu.units:
        if unit.name == name:
            return unit.dimension, unit.factor, unit.offset
    return None
