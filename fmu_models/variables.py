"""The variables of an FMU by name: which may be set when, and reading and writing them in one call.

FMPy ignores names it does not know and passes NaN on, so both are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fmpy import fmi2, fmi3

from .errors import PlantInputError, PlantNameError, PlantStepError, nearest

__all__ = ["Roles", "VariableAccess"]

# Type in the model description -> (get and set function, type in C).
_FMI2_TYPES: dict[str, tuple[str, Any]] = {
    "Real": ("Real", fmi2.fmi2Real),
    "Integer": ("Integer", fmi2.fmi2Integer),
    "Enumeration": ("Integer", fmi2.fmi2Integer),
    "Boolean": ("Boolean", fmi2.fmi2Boolean),
}
_FMI3_TYPES: dict[str, tuple[str, Any]] = {
    **{
        kind: (kind, getattr(fmi3, f"fmi3{kind}"))
        for kind in (
            *("Float64", "Float32", "Int64", "Int32", "Int16", "Int8"),
            *("UInt64", "UInt32", "UInt16", "UInt8", "Boolean"),
        )
    },
    "Enumeration": ("Int64", fmi3.fmi3Int64),
}
_REAL = ("Real", "Float64", "Float32")


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


class VariableAccess:
    """Reads and writes the variables of one FMU instance by name."""

    def __init__(self, description: Any) -> None:
        fmi2_file = description.fmiVersion.startswith("2.")
        self._prefix = "fmi2" if fmi2_file else "fmi3"
        self._types = _FMI2_TYPES if fmi2_file else _FMI3_TYPES
        self._reference = fmi2.fmi2ValueReference if fmi2_file else fmi3.fmi3ValueReference
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
            parameters=self._where(
                lambda v: (
                    v.causality in ("parameter", "input")
                    or (v.initial in ("exact", "approx") and v.variability != "constant")
                )
            ),
        )
        self._may_set: dict[bool, frozenset[str]] = {
            True: frozenset(self.roles.parameters),
            False: frozenset(self.roles.inputs + self.roles.tunable),
        }
        self._outputs = self._groups(self.roles.outputs, "Get")
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
            groups.append(
                _Group(
                    names=tuple(members),
                    function=f"{self._prefix}{action}{function}",
                    real=kind in _REAL,
                    boolean=kind == "Boolean",
                    references=(self._reference * len(members))(*references),
                    values=(c_type * len(members))(),
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
        allowed = self._may_set[before_start]
        if groups is None or before_start:
            for name in key:
                if name not in allowed:
                    raise PlantNameError(self._refusal(name, before_start))
            groups = self._writers.setdefault(key, self._groups(key, "Set"))
            if before_start:
                del self._writers[key]  # other names are allowed later
        for group in groups:
            for i, name in enumerate(group.names):
                group.values[i] = self._checked(group, name, values[name])
        for group in groups:
            self._call(fmu, group)

    def read_outputs(self, fmu: Any, time: float) -> dict[str, float]:
        """Return all outputs.

        Raises:
            PlantStepError: one of them is NaN or infinite.
        """
        result: dict[str, float] = {}
        for group in self._outputs:
            self._call(fmu, group)
            for name, value in zip(group.names, group.values, strict=True):
                if not math.isfinite(value):
                    raise PlantStepError(
                        f"plant {self._model}: output {name} is {value} at {time:g} s; the model "
                        "is unstable or was given inputs outside of its range"
                    )
                result[name] = float(value)
        return result

    def _call(self, fmu: Any, group: _Group) -> None:
        count = len(group.names)
        arguments = [fmu.component, group.references, count, group.values]
        if self._prefix == "fmi3":
            arguments.append(count)
        getattr(fmu, group.function)(*arguments)

    def _checked(self, group: _Group, name: str, value: float) -> float | int | bool:
        number = float(value)
        if not math.isfinite(number):
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
