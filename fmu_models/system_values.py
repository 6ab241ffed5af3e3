"""What stands at the connections of a system of FMUs now, and which component a name belongs to."""

from __future__ import annotations

from collections.abc import Mapping

from .errors import PlantFileError, PlantInputError, PlantNameError, nearest
from .ssp_structure import Link, SystemStructure

__all__ = ["SystemValues"]


class SystemValues:
    """Values of a system's inputs and of its components' outputs.

    Args:
        structure: the system.
        given: its own inputs and parameters, where the user gives them.

    Attributes:
        structure: the system.
        inputs: its own inputs and parameters by name.
        latest: by component, the outputs that it had last.
    """

    def __init__(self, structure: SystemStructure, given: Mapping[str, float]) -> None:
        self.structure = structure
        self.inputs = self._own_starts() | dict(given)
        self.latest: dict[str, dict[str, float]] = {}

    def split(self, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Return values of ``component.variable`` by component and variable.

        Raises:
            PlantNameError: there is no such component.
        """
        found: dict[str, dict[str, float]] = {}
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

    def _own_starts(self) -> dict[str, float]:
        """Return the start values of the system's own inputs and parameters, where it has some.

        An input that nothing gives leaves its components at their own start values; one that goes
        straight to an output begins at 0.
        """
        structure = self.structure
        straight = {link.name for link in structure.outputs.values() if not link.component}
        values = dict.fromkeys(straight, 0.0)
        for name, start in structure.starts.get("", {}).items():
            try:
                values[name] = start.number(structure.unit_of.get(("", name)), {})
            except PlantInputError as error:
                raise PlantFileError(f"{structure.file}: {name}: {error}") from error
        return values

    def _bring(self, link: Link) -> float | None:
        """Return what a link brings now; None while nothing has given it."""
        if not link.component:
            given = self.inputs.get(link.name)
            return None if given is None else link.convert(given)
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
        """Return what links bring now; one that nothing has given a value is left out."""
        pairs = {name: self._bring(link) for name, link in links.items()}
        return {name: value for name, value in pairs.items() if value is not None}
