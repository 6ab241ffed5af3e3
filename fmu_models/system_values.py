"""What stands at the connections of a system of FMUs now, and which component a name belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from .errors import PlantFileError, PlantInputError, PlantNameError, nearest
from .ssp_structure import Link, SystemStructure
from .start_values import StartValue

__all__ = ["SystemValues"]

_Value = TypeVar("_Value", float, str | float)


class SystemValues:
    """Values of a system's inputs and of its components' outputs.

    Args:
        structure: the system.
        given: its own inputs and parameters, where the user gives them.

    Attributes:
        structure: the system.
        inputs: its own inputs and parameters by name; parameters may be texts.
        latest: by component, the outputs that it had last.
    """

    def __init__(self, structure: SystemStructure, given: Mapping[str, StartValue]) -> None:
        self.structure = structure
        for name, value in given.items():
            if isinstance(value, str) and name in structure.inputs:
                raise PlantInputError(
                    f"system {structure.name}: {name} = {value!r} cannot be set; it must be a "
                    "number"
                )
        self.inputs: dict[str, StartValue] = self._own_starts() | dict(given)
        self.latest: dict[str, dict[str, float]] = {}

    def split(self, values: Mapping[str, _Value]) -> dict[str, dict[str, _Value]]:
        """Return values of ``component.variable`` by component and variable.

        Raises:
            PlantNameError: there is no such component.
        """
        found: dict[str, dict[str, _Value]] = {}
        for name, value in values.items():
            component = max(
                (c for c in self.structure.sources if name.startswith(f"{c}.")),
                key=len,
                default=None,
            )
            if component is None:
                known = (*self.structure.inputs, *(f"{c}." for c in self.structure.sources))
                raise PlantNameError(
                    f"system {self.structure.name} has no component of {name!r}; "
                    f"{nearest(name, known)}"
                )
            found.setdefault(component, {})[name[len(component) + 1 :]] = value
        return found

    def _own_starts(self) -> dict[str, StartValue]:
        """Return the start values of the system's own inputs and parameters, where it has some.

        An input that nothing gives leaves its components at their own start values; one that goes
        straight to an output begins at 0.
        """
        structure = self.structure
        straight = {link.name for link in structure.outputs.values() if not link.component}
        values: dict[str, StartValue] = dict.fromkeys(straight, 0.0)
        for name, start in structure.starts.get("", {}).items():
            try:
                unit = structure.unit_of.get(("", name))
                values[name] = start.text() if start.is_text else start.number(unit, {})
            except PlantInputError as error:
                raise PlantFileError(f"{structure.file}: {name}: {error}") from error
        return values

    def _bring(self, link: Link) -> float | None:
        """Return what a link brings now; None while nothing has given it, and for a text."""
        if not link.component:
            given = self.inputs.get(link.name)
            return None if given is None or isinstance(given, str) else link.convert(given)
        found = self.latest.get(link.component)
        if found is None:
            return None
        if link.name not in found:
            raise PlantNameError(
                f"system {self.structure.name}: {link.component} has no output {link.name!r}; "
                f"{nearest(link.name, found)}"
            )
        return link.convert(found[link.name])

    def given_by(self, links: Mapping[str, Link]) -> dict[str, float]:
        """Return the numbers that links bring now; one that nothing has given is left out."""
        pairs = {name: self._bring(link) for name, link in links.items()}
        return {name: value for name, value in pairs.items() if value is not None}

    def texts_by(self, links: Mapping[str, Link]) -> dict[str, str]:
        """Return the texts that links bring at the start.

        Raises:
            PlantInputError: a text goes through a transformation, or through a change of unit.
        """
        found = {}
        for name, link in links.items():
            text = self.inputs.get(link.name) if not link.component else None
            if isinstance(text, str):
                if link.changes:
                    raise PlantInputError(
                        f"system {self.structure.name}: {link.name} = {text!r} cannot be set; its "
                        f"connection to {name} converts numbers, give it one"
                    )
                found[name] = text
        return found
