"""Variables of one type in one memory, which one call of the FMU reads or writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from numpy.typing import NDArray

from .errors import PlantInputError
from .library import call_checked
from .variable_types import FUNCTIONS, REAL_TYPES, REFERENCE_TYPES, describe_range, view_memory

__all__ = ["VariableGroup", "group_variables"]


@dataclass(frozen=True, slots=True)
class VariableGroup:
    """Variables of one type, read or written by one call; arrays with all their elements."""

    names: tuple[str, ...]
    given: tuple[str, ...]
    """Of the names, those that the caller reads or writes."""
    function: str
    real: bool
    boolean: bool
    references: Any
    values: Any
    arguments: tuple[Any, ...]
    """What the function takes after the instance."""
    view: NDArray[Any]
    """The memory of ``values`` as an array."""
    columns: Any
    """Where the values given go in a row of all outputs."""
    order: tuple[int, ...]
    """Where the values given stand in ``view``."""
    places: Any
    """The same as a slice, where they stand side by side."""

    def call(self, fmu: Any) -> None:
        """Read or write them.

        Raises:
            FMICallException: the FMU refused.
        """
        call_checked(fmu, self.function, fmu.component, *self.arguments)

    def check(self, model: str, name: str, value: float) -> float | int | bool:
        """Return a value as the type of these variables takes it.

        Raises:
            PlantInputError: not finite, or not whole where the variable is not a real number.
        """
        number = float(value)
        if not isfinite(number):
            raise PlantInputError(
                f"plant {model}: {name} = {number:g} cannot be set; it must be a finite number"
            )
        if self.real:
            return number
        whole = int(number)
        c_type = self.values._type_
        fits = number in (0.0, 1.0) if self.boolean else c_type(whole).value == whole
        if whole != number or not fits:
            raise PlantInputError(
                f"plant {model}: {name} = {number:g} cannot be set; it must be "
                + ("0 or 1" if self.boolean else f"a whole number from {describe_range(c_type)}")
            )
        return whole


def group_variables(
    version: int,
    names: Sequence[str],
    variables: Mapping[str, Any],
    elements: Mapping[str, Sequence[str]],
    action: str,
) -> tuple[VariableGroup, ...]:
    """Return groups by type, in the order of ``names``.

    Args:
        version: of FMI.
        names: of numbers; an element of an array is one.
        variables: FMPy's description of each.
        elements: names of all numbers of a variable, by the variable's name.
        action: "Get" or "Set".
    """
    types = FUNCTIONS[version]
    position = {name: i for i, name in enumerate(names)}
    by_type: dict[str, dict[str, Any]] = {}
    for name in names:
        v = variables[name]
        by_type.setdefault(v.type, {})[v.name] = v
    groups = []
    for kind, members_by_name in by_type.items():
        function, c_type = types[kind]
        members = [name for variable in members_by_name for name in elements[variable]]
        given = [i for i, name in enumerate(members) if name in position]
        references = [v.valueReference for v in members_by_name.values()]
        values = (c_type * len(members))()
        addresses = (REFERENCE_TYPES[version] * len(references))(*references)
        sizes = (len(members),) if version == 3 else ()
        groups.append(
            VariableGroup(
                names=tuple(members),
                given=tuple(members[i] for i in given),
                function=f"fmi{version}{action}{function}",
                real=kind in REAL_TYPES,
                boolean=kind == "Boolean",
                references=addresses,
                values=values,
                arguments=(addresses, len(references), values, *sizes),
                view=view_memory(values),
                columns=_as_slice([position[members[i]] for i in given]),
                order=tuple(given),
                places=_as_slice(given),
            )
        )
    return tuple(groups)


def _as_slice(columns: list[int]) -> slice | list[int]:
    """Return the columns as a slice where they stand side by side: copying is faster then."""
    first = columns[0]
    together = columns == list(range(first, first + len(columns)))
    return slice(first, first + len(columns)) if together else columns
