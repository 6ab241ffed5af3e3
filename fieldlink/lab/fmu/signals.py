"""What a run writes and reads: tags, the variables behind them, and their units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.lab.fmu.mapping import FmuMap, InputMap, OutputMap
from fieldlink.lab.fmu.units import Conversion, conversion
from fmu_models import FmuSummary, StartValue, VariableSummary

__all__ = ["SETPOINT", "Signals", "is_number", "words_of"]

Array = NDArray[np.float64]
SETPOINT = "SP"
_LARGEST_WHOLE = 2.0**53
"""Up to which a double holds every whole number."""


def is_number(variable: VariableSummary) -> bool:
    """Whether a variable is read and written as a number."""
    return variable.type not in ("String", "Binary", "Clock")


def words_of(variable: VariableSummary | None) -> dict[str, float]:
    """Return the words that stand for values of a variable: booleans and enumerations."""
    if variable is None:
        return {}
    words = {item: float(value) for value, item in variable.items}
    return {"true": 1.0, "false": 0.0} if variable.type == "Boolean" else words


def _limit(text: str, default: float) -> float:
    """A limit of a description; the default where it names none, or no number."""
    try:
        value = float(text)
    except ValueError:
        return default
    return default if math.isnan(value) else value


class Signals:
    """Tags of a run.

    Args:
        fmu: what the archive says.
        mapping: the map; what it does not mention keeps its own name.
        sizes: values of structural parameters, which decide how many elements arrays have.
        watch: further variables to record.

    Attributes:
        inputs: by tag.
        outputs: by tag.
        conversions: by tag, inputs and outputs.

    Raises:
        FmuError: no outputs, or a unit that does not convert.
    """

    def __init__(
        self, fmu: FmuSummary, mapping: FmuMap, sizes: Mapping[str, float], watch: Sequence[str]
    ) -> None:
        self._fmu = fmu
        self._setpoint_unit = mapping.controller.pv if mapping.controller else None
        mapped = {entry.variable for entry in mapping.inputs.values()}
        self.inputs = dict(mapping.inputs)
        self.outputs = dict(mapping.outputs)
        for variable in fmu.variables:
            if not is_number(variable):
                continue
            for name in fmu.elements(variable, sizes):
                if variable.causality == "input" and name not in mapped:
                    self.inputs[name] = InputMap(variable=name)
                elif variable.causality == "output" and not mapping.outputs:
                    self.outputs[name] = OutputMap(variable=name)
        for name in watch:
            found = fmu.variable(name)
            whole = found is not None and found.name == name
            for element in fmu.elements(found, sizes) if found is not None and whole else (name,):
                self.outputs.setdefault(element, OutputMap(variable=element))
        if not self.outputs:
            raise FmuError(
                f"{fmu.file.name}: it has no outputs; name variables to record with --watch, "
                f"{nearest('', (v.name for v in fmu.variables if is_number(v)))}"
            )
        self.conversions: dict[str, Conversion] = {}
        for tag, written in self.inputs.items():
            self.conversions[tag] = conversion(fmu, written.variable, written.unit)
        for tag, read in self.outputs.items():
            self.conversions[tag] = conversion(fmu, read.variable, read.unit)

    def to_variables(self, driven: Mapping[str, Array]) -> dict[str, Array]:
        """Return the values of driven tags by variable, in the FMU's units."""
        return {
            self.inputs[tag].variable: self.conversions[tag].scale * values
            + self.conversions[tag].offset
            for tag, values in driven.items()
            if tag in self.inputs
        }

    def to_tag(self, tag: str, values: Array) -> Array:
        """Return values of an output in its tag's unit."""
        change = self.conversions[tag]
        return (values - change.offset) / change.scale

    def unit(self, tag: str) -> str:
        """Return the unit of a tag, empty where unknown."""
        if tag == SETPOINT and self._setpoint_unit is not None:
            tag = self._setpoint_unit
        entry = self.inputs.get(tag) or self.outputs.get(tag)
        if entry is None:
            return ""
        variable = self._fmu.variable(entry.variable)
        return entry.unit or (variable.unit if variable is not None else "")

    def list_rounded(self, columns: Mapping[str, Array]) -> list[str]:
        """Return the outputs whose whole numbers are too large for a table of doubles."""
        large = []
        for tag, out in self.outputs.items():
            variable = self._fmu.variable(out.variable)
            whole = variable is not None and variable.type in ("Int64", "UInt64")
            if whole and (np.abs(columns[tag]) >= _LARGEST_WHOLE).any():
                large.append(tag)
        return large

    def list_outside(self, values: Mapping[str, Array]) -> list[str]:
        """Return the variables that are given a value outside of the range that the FMU names.

        Args:
            values: by variable, in its unit.
        """
        outside = []
        for name, given in values.items():
            variable = self._fmu.variable(name)
            if variable is None or not given.size:
                continue
            low, high = _limit(variable.low, -math.inf), _limit(variable.high, math.inf)
            least, most = float(given.min()), float(given.max())
            if least < low or most > high:
                worst = most if most > high else least
                outside.append(f"{name} = {worst:g} (range {low:g} to {high:g})")
        return outside

    def undriven(self, driven: set[str], start_values: Mapping[str, StartValue]) -> list[str]:
        """Return the inputs that keep their start values.

        Raises:
            FmuError: one of them has no start value.
        """
        found: list[str] = []
        for tag, entry in self.inputs.items():
            variable = self._fmu.variable(entry.variable)
            if tag in driven or entry.variable in start_values:
                continue
            if variable is None or variable.causality != "input":
                continue
            if not variable.start:
                raise FmuError(
                    f"{self._fmu.file.name}: input {entry.variable} has no start value and nothing "
                    "drives it; give it one in the map, as a column of the inputs, or with --set "
                    f"{entry.variable}=VALUE"
                )
            found.append(tag)
        return found
