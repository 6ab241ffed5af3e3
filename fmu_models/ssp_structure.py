"""What a flattened system of FMUs is: its components, what feeds them, and their start values."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from .ssp_changes import Change, apply_changes
from .ssp_values import SiUnit, Start

__all__ = ["Link", "Master", "SystemStructure"]

Master = Literal["gauss-seidel", "jacobi"]


@dataclass(frozen=True, slots=True)
class Link:
    """Where a value comes from, and what happens to it on its way.

    ``component`` is empty for an input or a parameter of the whole system.
    """

    component: str
    name: str
    changes: tuple[Change, ...] = ()

    def convert(self, value: float) -> float:
        """Return the value at this end of the connection."""
        return apply_changes(self.changes, value)

    def invert(self, value: float) -> float | None:
        """Return what must go in to get ``value`` out; None where a table does not say."""
        for change in reversed(self.changes):
            found = change.invert(value)
            if found is None:
                return None
            value = found
        return value


@dataclass(slots=True)
class SystemStructure:
    """A flattened system.

    Attributes:
        file: the archive.
        name: of the system.
        sources: by component (``sub.valve`` inside a system ``sub``), its FMU in the archive.
        starts: by component, start values by variable; by "" those of the system itself.
        unit_of: units of connectors by ``(component, variable)``, where they are defined.
        links: by component and input, what feeds it.
        parameter_links: by component and parameter, which parameter of the system sets it.
        inputs: of the whole system, with units.
        parameters: of the whole system, those that set one of a component.
        outputs: of the whole system, what feeds them.
        ignored: names of start values that no component has a place for.
        start, stop: of the default experiment in seconds, None where not given.
        step, master: of the recorded run that the archive is an export of; None for none.
    """

    file: Path
    name: str
    sources: dict[str, str] = field(default_factory=dict)
    starts: dict[str, dict[str, Start]] = field(default_factory=dict)
    unit_of: dict[tuple[str, str], SiUnit] = field(default_factory=dict)
    links: dict[str, dict[str, Link]] = field(default_factory=dict)
    parameter_links: dict[str, dict[str, Link]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    outputs: dict[str, Link] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)
    start: float | None = None
    stop: float | None = None
    step: float | None = None
    master: Master | None = None

    def order(self) -> list[str]:
        """Return the components in the order in which they step.

        A component comes after those that feed it; a loop is begun by the one that is named first.
        """
        left, placed = list(self.sources), []
        while left:
            ready = (
                c
                for c in left
                if all(
                    link.component not in left or link.component == c
                    for link in self.links.get(c, {}).values()
                )
            )
            chosen = next(ready, left[0])
            left.remove(chosen)
            placed.append(chosen)
        return placed
