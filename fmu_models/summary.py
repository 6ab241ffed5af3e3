"""What an FMU or a system of FMUs is, before anything of it runs, as one record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from .arrays import element_names

__all__ = ["FmuSummary", "UnitDefinition", "VariableSummary"]


@dataclass(frozen=True, slots=True)
class UnitDefinition:
    """A unit as an FMU defines it: ``SI value = factor * value + offset``.

    Attributes:
        name: as the variables call it.
        dimension: exponents of kg, m, s, A, K, mol, cd, rad.
        factor: to SI units.
        offset: to SI units.
        shown: display units: name, factor and offset; ``shown value = factor * value + offset``.
    """

    name: str
    dimension: tuple[int, ...]
    factor: float
    offset: float
    shown: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, slots=True)
class VariableSummary:
    """A variable; ``unit``, ``start``, ``low`` and ``high`` are empty where the FMU says nothing.

    ``items`` are the names of an enumeration's values, ``settable`` says whether it can be given
    before the start. ``shape`` are the sizes of an array, ``()`` for a scalar; ``sized_by`` names
    the structural parameter that decides each of them, empty for a fixed size. ``relative`` is true
    of a difference, such as one of temperatures, whose unit converts without its offset.
    """

    name: str
    type: str
    causality: str
    variability: str
    unit: str
    start: str
    low: str
    high: str
    description: str
    settable: bool
    scalar: bool
    items: tuple[tuple[int, str], ...]
    shape: tuple[int, ...]
    sized_by: tuple[str, ...]
    relative: bool = False


@dataclass(frozen=True)
class FmuSummary:
    """An FMU as its archive describes it.

    Attributes:
        file: where it stands.
        name: of the model.
        fmi_version: such as "2.0".
        description: the author's words.
        tool: what exported it, and when.
        kinds: co-simulation, model exchange, scheduled execution.
        platforms: that it has libraries for, by folder.
        runs_here: whether one of them is this machine's.
        has_sources: whether it carries C sources.
        bytes: of the file.
        extracted_bytes: of its contents.
        start_time, stop_time, step_size, tolerance: the default experiment; None where not given.
        can_restore: whether it offers snapshots (in the kind that runs by default).
        states: continuous states.
        units: its unit definitions.
        variables: all of them, in the file's order.
        warnings: what a user should know before running it.
    """

    file: Path
    name: str
    fmi_version: str
    description: str
    tool: str
    kinds: tuple[str, ...]
    platforms: tuple[str, ...]
    runs_here: bool
    has_sources: bool
    bytes: int
    extracted_bytes: int
    start_time: float
    stop_time: float | None
    step_size: float | None
    tolerance: float | None
    can_restore: bool
    states: int
    units: tuple[UnitDefinition, ...]
    variables: tuple[VariableSummary, ...]
    warnings: tuple[str, ...]

    def variable(self, name: str) -> VariableSummary | None:
        """Return a variable by name; an element such as ``y[2]`` is its array."""
        found = self._by_name.get(name)
        if found is None and name.endswith("]"):
            array = self._by_name.get(name.rpartition("[")[0])
            found = None if array is None or array.scalar else array
        return found

    @cached_property
    def _by_name(self) -> Mapping[str, VariableSummary]:
        return {v.name: v for v in reversed(self.variables)}

    def elements(
        self, variable: VariableSummary, sizes: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[str, ...]:
        """Return the names of a variable's numbers: its own, or those of an array's elements.

        Args:
            variable: one of `variables`.
            sizes: values of structural parameters that are not their start values.
        """
        if variable.scalar:
            return (variable.name,)
        pairs = zip(variable.sized_by, variable.shape, strict=True)
        shape = tuple(int(sizes.get(name, size)) for name, size in pairs)
        return element_names(variable.name, shape)
