"""The variables of an FMU by name: which may be set when, and reading and writing them in one call.

FMPy ignores names it does not know and passes NaN on, so both are checked here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from fmpy import fmi1, fmi2, fmi3
from numpy.typing import NDArray

from .errors import PlantInputError, PlantNameError, PlantStepError, nearest

__all__ = ["Roles", "VariableAccess", "is_settable"]

# Version of FMI -> type in the model description -> (get and set function, type in C).
_TYPES: dict[int, dict[str, tuple[str, Any]]] = {
    1: {
        "Real": ("Real", fmi1.fmi1Real),
        "Integer": ("Integer", fmi1.fmi1Integer),
        "Enumeration": ("Integer", fmi1.fmi1Integer),
        "Boolean": ("Boolean", fmi1.fmi1Boolean),
    },
    2: {
        "Real": ("Real", fmi2.fmi2Real),
        "Integer": ("Integer", fmi2.fmi2Integer),
        "Enumeration": ("Integer", fmi2.fmi2Integer),
        "Boolean": ("Boolean", fmi2.fmi2Boolean),
    },
    3: {
        **{
            kind: (kind, getattr(fmi3, f"fmi3{kind}"))
            for kind in (
                *("Float64", "Float32", "Int64", "Int32", "Int16", "Int8"),
                *("UInt64", "UInt32", "UInt16", "UInt8", "Boolean"),
            )
        },
        "Enumeration": ("Int64", fmi3.fmi3Int64),
    },
}
_REFERENCES = {
    1: fmi1.fmi1ValueReference,
    2: fmi2.fmi2ValueReference,
    3: fmi3.fmi3ValueReference,
}
_REAL = ("Real", "Float64", "Float32")


def is_settable(variable: Any) -> bool:
    """Whether a variable (FMPy's) can be set before the start, in every version of FMI."""
    if variable.causality in ("parameter", "input"):
        return True
    if variable.causality in ("independent", "structuralParameter", "calculatedParameter"):
        return False
    if variable.variability == "constant":
        return False
    if variable.initial is None:  # FMI 1 has no such attribute: what has a start value
        return variable.start is not None
    return variable.initial in ("exact", "approx")


@dataclass(frozen=True, slots=True)
class Roles:
    """The names of an FMU's numeric scalar variables, by what may be done with them."""

    inputs: tuple[str, ...]
    tunable: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Group:
    """Variables of one type, read or written by one call."""

    names: tuple[str, ...]
    function: str
    real: bool
    boolean: bool
    references: Any
    values: Any
    view: NDArray[Any]
    """The memory of ``values`` as an array."""
    columns: Any
    """Where the values go in a row of all outputs."""


class VariableAccess:
    """Reads and writes the variables of one FMU instance by name.

    Args:
        description: FMPy's model description.
        watch: names that are read with the outputs.

    Raises:
        PlantNameError: a watched variable does not exist, or is no scalar number.
    """

    def __init__(self, description: Any, watch: Sequence[str] = ()) -> None:
        self._version = int(description.fmiVersion[0])
        self._types = _TYPES[self._version]
        self._variables: dict[str, Any] = {
            v.name: v
            for v in description.modelVariables
            if v.type in self._types and not v.dimensions
        }
        self._model = description.modelName
        self.roles = Roles(
            inputs=self._where(lambda v: v.causality == "input"),
            tunable=self._where(
                lambda v: v.causality == "parameter" and v.variability == "tunable"
            ),
            outputs=self._where(lambda v: v.causality == "output"),
            parameters=self._where(is_settable),
        )
        self._may_set: dict[bool, frozenset[str]] = {
            True: frozenset(self.roles.parameters),
            False: frozenset(self.roles.inputs + self.roles.tunable),
        }
        for name in watch:
            if name not in self._variables:
                raise PlantNameError(
                    f"plant {self._model} has no number {name!r}; {nearest(name, self._variables)}"
                )
        self.watched = tuple(n for n in dict.fromkeys(watch) if n not in self.roles.outputs)
        self._names = (*self.roles.outputs, *self.watched)
        self._outputs = self._groups(self._names, "Get")
        self._writers: dict[tuple[str, ...], tuple[_Group, ...]] = {}

    def _where(self, condition: Any) -> tuple[str, ...]:
        return tuple(name for name, v in self._variables.items() if condition(v))

    def _groups(self, names: Sequence[str], action: str) -> tuple[_Group, ...]:
        by_type: dict[str, list[str]] = {}
        for name in names:
            by_type.setdefault(self._variables[name].type, []).append(name)
        groups = []
        for kind, members in by_type.items():
            function, c_type = self._types[kind]
            references = [self._variables[name].valueReference for name in members]
            values = (c_type * len(members))()
            columns = [names.index(name) for name in members]
            groups.append(
                _Group(
                    names=tuple(members),
                    function=f"fmi{self._version}{action}{function}",
                    real=kind in _REAL,
                    boolean=kind == "Boolean",
                    references=(_REFERENCES[self._version] * len(members))(*references),
                    values=values,
                    view=_view(values),
                    columns=_as_slice(columns),
                )
            )
        return tuple(groups)

    def write(self, fmu: Any, values: Mapping[str, float], *, before_start: bool) -> None:
        """Set variables; nothing is set when a name or a value is wrong.

        Raises:
            PlantNameError: no such variable, or it cannot be set now.
            PlantInputError: not finite, or not whole where the variable is no real number.
        """
        if not values:
            return
        key = tuple(values)
        groups = self._writers.get(key)
        if groups is None or before_start:
            self._check_names(key, before_start)
            groups = self._writers.setdefault(key, self._groups(key, "Set"))
            if before_start:
                del self._writers[key]  # other names are allowed later
        for group in groups:
            for i, name in enumerate(group.names):
                value = values[name]
                if not (group.real and type(value) is float and isfinite(value)):
                    value = self._checked(group, name, value)
                group.view[i] = value
        for group in groups:
            self._call(fmu, group)

    def _check_names(self, names: Iterable[str], before_start: bool) -> None:
        for name in names:
            if name not in self._may_set[before_start]:
                raise PlantNameError(self._refusal(name, before_start))

    def read_outputs(self, fmu: Any, time: float) -> dict[str, float]:
        """Return all outputs, and what is watched.

        Raises:
            PlantStepError: one of them is NaN or infinite.
        """
        if len(self._outputs) == 1 and self._outputs[0].real:
            self._call(fmu, self._outputs[0])
            row = self._outputs[0].view.tolist()
        else:
            table = np.empty(len(self._names))
            self.read_row(fmu, table)
            row = table.tolist()
        if not all(map(isfinite, row)):
            pairs = zip(self._names, row, strict=True)
            name, value = next((name, value) for name, value in pairs if not isfinite(value))
            raise PlantStepError(self.not_finite(name, value, time))
        return dict(zip(self._names, row, strict=True))

    def read_row(self, fmu: Any, row: NDArray[np.float64]) -> None:
        """Read all outputs into ``row``; whoever calls looks for NaN, many rows at once."""
        for group in self._outputs:
            self._call(fmu, group)
            row[group.columns] = group.view

    def column_writer(
        self, columns: Mapping[str, NDArray[np.float64]]
    ) -> Callable[[Any, int], None]:
        """Return a function of the FMU and a row that sets inputs from columns checked here.

        Raises:
            PlantError: as `write` does.
        """
        self._check_names(columns, before_start=False)
        groups = self._groups(tuple(columns), "Set")
        tables = [np.column_stack([columns[name] for name in group.names]) for group in groups]
        for group, table in zip(groups, tables, strict=True):
            for i, name in enumerate(group.names):
                distinct = table[:, i] if group.real else np.unique(table[:, i])
                doubtful = distinct[~np.isfinite(distinct)] if group.real else distinct
                for value in doubtful:
                    self._checked(group, name, float(value))
        pairs = list(zip(groups, tables, strict=True))

        def write(fmu: Any, k: int) -> None:
            for group, table in pairs:
                group.view[:] = table[k]
                self._call(fmu, group)

        return write

    def not_finite(self, name: str, value: float, time: float) -> str:
        """Return the message about an output that is no number."""
        return (
            f"plant {self._model}: output {name} is {value} at {time:g} s; the model is unstable "
            "or was given inputs outside of its range"
        )

    def _call(self, fmu: Any, group: _Group) -> None:
        count = len(group.names)
        function = getattr(fmu, group.function)
        if self._version == 3:
            function(fmu.component, group.references, count, group.values, count)
        else:
            function(fmu.component, group.references, count, group.values)

    def _checked(self, group: _Group, name: str, value: float) -> float | int | bool:
        number = float(value)
        if not isfinite(number):
            raise PlantInputError(
                f"plant {self._model}: {name} = {number:g} cannot be set; it must be a finite "
                "number"
            )
        if group.real:
            return number
        whole = int(number)
        c_type = group.values._type_
        fits = number in (0.0, 1.0) if group.boolean else c_type(whole).value == whole
        if whole != number or not fits:
            raise PlantInputError(
                f"plant {self._model}: {name} = {number:g} cannot be set; it must be "
                + ("0 or 1" if group.boolean else f"a whole number that fits {c_type.__name__}")
            )
        return whole

    def _refusal(self, name: str, before_start: bool) -> str:
        allowed = self._may_set[before_start]
        variable = self._variables.get(name)
        role = "parameter or input" if before_start else "input or tunable parameter"
        if variable is None:
            return f"plant {self._model} has no {role} {name!r}; {nearest(name, allowed)}"
        if variable.causality == "parameter":
            return (
                f"plant {self._model}: parameter {name!r} is fixed; give it when the plant is "
                "opened"
            )
        return (
            f"plant {self._model}: {name!r} is {variable.causality} ({variable.variability}) and "
            f"cannot be set; {nearest(name, allowed)}"
        )


def _view(values: Any) -> NDArray[Any]:
    """Return the memory of a C array as a NumPy array; FMI 1's booleans are bytes."""
    if values._type_ is fmi1.fmi1Boolean:
        return np.frombuffer(values, dtype=np.uint8)
    array: NDArray[Any] = np.ctypeslib.as_array(values)
    return array


def _as_slice(columns: list[int]) -> slice | list[int]:
    """Return the columns as a slice where they stand side by side: copying is faster then."""
    first = columns[0]
    together = columns == list(range(first, first + len(columns)))
    return slice(first, first + len(columns)) if together else columns
