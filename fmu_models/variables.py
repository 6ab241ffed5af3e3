"""The variables of an FMU by name: which may be set when, and reading and writing them in one call.

FMPy ignores names it does not know and passes NaN on, so both are checked here. An element of an
array is a name of its own, ``y[1]`` or ``y[2,3]``, counted from 1 with the last index fastest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import element_names, resolve_shape
from .errors import PlantNameError, PlantStepError, nearest
from .start_values import list_texts
from .variable_groups import VariableGroup, group_variables
from .variable_types import (
    FUNCTIONS,
    LEFT_OUT,
    REAL_TYPES,
    is_settable,
    list_starts,
)

__all__ = ["Roles", "VariableAccess"]


@dataclass(frozen=True, slots=True)
class Roles:
    """The names of an FMU's numbers, by what may be done with them; arrays by their elements."""

    inputs: tuple[str, ...]
    tunable: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


class VariableAccess:
    """Reads and writes the variables of one FMU instance by name.

    Args:
        description: FMPy's model description.
        watch: names that are read with the outputs.
        structural: values of structural parameters, which decide the sizes of arrays.

    Raises:
        PlantNameError: a watched variable does not exist, or is not a number.
        PlantInputError: a size that no array can have.
    """

    def __init__(
        self,
        description: Any,
        watch: Sequence[str] = (),
        structural: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._version = int(description.fmiVersion[0])
        self._types = FUNCTIONS[self._version]
        self._variables: dict[str, Any] = {}
        self._elements: dict[str, tuple[str, ...]] = {}
        for v in description.modelVariables:
            if v.type in self._types:
                shape = resolve_shape(v, structural)
                names = element_names(v.name, shape) if v.dimensions else (v.name,)
                self._elements[v.name] = names
                self._variables |= dict.fromkeys(names, v)
        self._model = description.modelName
        self._texts = list_texts(description)
        self.roles = Roles(
            inputs=self._where(lambda v: v.causality == "input"),
            tunable=self._where(
                lambda v: v.causality == "parameter" and v.variability == "tunable"
            ),
            outputs=self._where(lambda v: v.causality == "output"),
            parameters=self._where(is_settable),
        )
        self._last = {
            name: start
            for v in description.modelVariables
            if v.dimensions and v.type in self._types
            for name, start in zip(self._elements[v.name], list_starts(v), strict=False)
        }
        self.structural = tuple(self._where(lambda v: v.causality == "structuralParameter"))
        self._may_set: dict[bool, frozenset[str]] = {
            True: frozenset(self.roles.parameters),
            False: frozenset(self.roles.inputs + self.roles.tunable),
        }
        whole = [self._elements.get(name, (name,)) for name in watch]
        watch = [name for names in whole for name in names]
        others = {v.name: v for v in description.modelVariables if v.type in LEFT_OUT}
        for name in watch:
            if name in others:
                raise PlantNameError(
                    f"plant {self._model}: {name} cannot be recorded, {LEFT_OUT[others[name].type]}"
                )
            if name not in self._variables:
                raise PlantNameError(
                    f"plant {self._model} has no number {name!r}; {nearest(name, self._variables)}"
                )
        self.watched = tuple(n for n in dict.fromkeys(watch) if n not in self.roles.outputs)
        self._names = (*self.roles.outputs, *self.watched)
        self._outputs = self._groups(self._names, "Get")
        self._writers: dict[tuple[str, ...], tuple[VariableGroup, ...]] = {}

    def _where(self, condition: Any) -> tuple[str, ...]:
        return tuple(name for name, v in self._variables.items() if condition(v))

    def _groups(self, names: Sequence[str], action: str) -> tuple[VariableGroup, ...]:
        return group_variables(self._version, names, self._variables, self._elements, action)

    def write(self, fmu: Any, values: Mapping[str, float], *, before_start: bool) -> None:
        """Set variables; nothing is set when a name or a value is wrong.

        Raises:
            PlantNameError: no such variable, or it cannot be set now.
            PlantInputError: not finite, or not whole where the variable is not a real number.
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
            if len(group.given) < len(group.names):
                self._fill_rest(group)
            for i, name in zip(group.order, group.given, strict=True):
                value = values[name]
                if not (group.real and type(value) is float and isfinite(value)):
                    value = group.check(self._model, name, value)
                group.view[i] = value
        for group in groups:
            group.call(fmu)
            self._remember(group)

    def check_start(self, values: Mapping[str, float]) -> None:
        """Check start values without setting them.

        Raises:
            PlantNameError, PlantInputError: as `write` does.
        """
        self._check_names(values, before_start=True)
        for group in self._groups(tuple(values), "Set"):
            for name in group.given:
                group.check(self._model, name, values[name])

    @property
    def output_references(self) -> list[int]:
        """Value references of the outputs and of what is watched."""
        return [int(r) for group in self._outputs for r in group.references]

    def is_whole(self, name: str) -> bool:
        """Whether a variable takes whole numbers only."""
        return self._variables[name].type not in REAL_TYPES

    def write_structural(self, fmu: Any, values: Mapping[str, float]) -> None:
        """Set structural parameters; the FMU stands in configuration mode."""
        for group in self._groups(tuple(values), "Set"):
            for i, name in zip(group.order, group.given, strict=True):
                group.view[i] = group.check(self._model, name, values[name])
            group.call(fmu)

    def _fill_rest(self, group: VariableGroup) -> None:
        """Put the elements that are not given, which keep their values."""
        for i, name in enumerate(group.names):
            if name in self._last:
                group.view[i] = self._last[name]

    def _remember(self, group: VariableGroup) -> None:
        if self._last and len(group.references) < len(group.names):
            for i, name in enumerate(group.names):
                if name in self._last:
                    self._last[name] = float(group.view[i])

    def refresh(self, fmu: Any) -> None:
        """Read the elements of arrays that can be set, after a state was restored."""
        if self._last:
            for group in self._groups([n for n in self._last if n in self._may_set[False]], "Get"):
                group.call(fmu)
                self._last |= zip(group.names, map(float, group.view), strict=True)

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
            self._outputs[0].call(fmu)
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
        """Read all outputs into ``row``; the caller looks for NaN, many rows at once."""
        for group in self._outputs:
            group.call(fmu)
            row[group.columns] = group.view[group.places]

    def column_writer(
        self, columns: Mapping[str, NDArray[np.float64]]
    ) -> Callable[[Any, int], None]:
        """Check columns of inputs; return a function that sets the inputs from one of their rows.

        Raises:
            PlantError: as `write` does.
        """
        self._check_names(columns, before_start=False)
        groups = self._groups(tuple(columns), "Set")
        tables = [np.column_stack([columns[name] for name in group.given]) for group in groups]
        for group, table in zip(groups, tables, strict=True):
            self._fill_rest(group)
            for i, name in enumerate(group.given):
                distinct = table[:, i] if group.real else np.unique(table[:, i])
                doubtful = distinct[~np.isfinite(distinct)] if group.real else distinct
                for value in doubtful:
                    group.check(self._model, name, float(value))
        pairs = list(zip(groups, tables, strict=True))

        def write(fmu: Any, k: int) -> None:
            for group, table in pairs:
                group.view[group.places] = table[k]
                group.call(fmu)
                self._remember(group)

        return write

    def not_finite(self, name: str, value: float, time: float) -> str:
        """Return the message about an output that is not a number."""
        return (
            f"plant {self._model}: output {name} is {value} at {time:g} s; the model is unstable "
            "or was given inputs outside of its range"
        )

    def _refusal(self, name: str, before_start: bool) -> str:
        allowed = self._may_set[before_start]
        variable = self._variables.get(name)
        role = "parameter or input" if before_start else "input or tunable parameter"
        if variable is None and name in self._texts:
            return (
                f"plant {self._model}: {name!r} is text, which cannot change during a run; give it "
                "when the plant is opened"
            )
        if variable is None:
            known = (*allowed, *self._texts) if before_start else allowed
            return f"plant {self._model} has no {role} {name!r}; {nearest(name, known)}"
        if variable.causality == "parameter":
            return (
                f"plant {self._model}: parameter {name!r} is fixed; give it when the plant is "
                "opened"
            )
        return (
            f"plant {self._model}: {name!r} is {variable.causality} ({variable.variability}) and "
            f"cannot be set; {nearest(name, allowed)}"
        )
