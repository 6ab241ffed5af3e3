"""The map: which tag is which variable of an FMU, in which unit, and what drives it.

period = 1.0

[parameters]
"valve.stiction" = 4.0

[inputs.OP]
variable = "valve.opening"
unit = "%"
value = 50.0

[outputs.PV]
variable = "tank.h"
unit = "mm"

[controller]
op = "OP"
pv = "PV"
gain = 0.4
integral_time = 30.0
setpoint = [[0.0, 500.0], [600.0, 650.0]]
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.site.start_value import StartValue
from fmu_models import FmuSummary

__all__ = ["ControllerMap", "FmuMap", "InputMap", "OutputMap", "load_map"]

_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class InputMap(_Strict):
    """A tag that is written to the FMU; ``value`` holds until something else drives it."""

    variable: str
    unit: str | None = None
    value: _Finite | None = None


class OutputMap(_Strict):
    """A tag that is read from the FMU: an output, or any other number of it."""

    variable: str
    unit: str | None = None


class ControllerMap(_Strict):
    """A PI controller between two tags, in their units; ``setpoint`` is (second, value) steps."""

    op: str
    pv: str
    gain: _Finite
    integral_time: _Positive
    setpoint: tuple[tuple[_Finite, _Finite], ...] = Field(min_length=1)
    low: _Finite = 0.0
    high: _Finite = 100.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        moments = [moment for moment, _ in self.setpoint]
        if moments != sorted(set(moments)):
            raise ValueError("setpoint: the moments must increase")
        if self.low >= self.high:
            raise ValueError(f"low {self.low} must be below high {self.high}")
        if self.gain == 0.0:
            raise ValueError("gain must not be zero; its sign is that of the process gain")
        return self

    def at(self, moment: float) -> float:
        """Return the set-point at a second of the experiment."""
        value = self.setpoint[0][1]
        for begins, then in self.setpoint:
            if moment >= begins - 1e-9:
                value = then
        return value


class FmuMap(_Strict):
    """A whole map; an empty one runs an FMU as it is."""

    period: _Positive | None = None
    parameters: dict[str, StartValue] = {}
    inputs: dict[str, InputMap] = {}
    outputs: dict[str, OutputMap] = {}
    controller: ControllerMap | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        both = self.inputs.keys() & self.outputs.keys()
        if both:
            raise ValueError(f"{', '.join(sorted(both))}: a tag is an input or an output, not both")
        taken: dict[str, str] = {}
        for tag, entry in self.inputs.items():
            if entry.variable in taken:
                raise ValueError(f"{tag} and {taken[entry.variable]} both write {entry.variable}")
            taken[entry.variable] = tag
        controller = self.controller
        if controller is not None:
            if controller.op not in self.inputs:
                raise ValueError(f"controller.op {controller.op!r} is not a tag of [inputs]")
            if controller.pv not in self.outputs:
                raise ValueError(f"controller.pv {controller.pv!r} is not a tag of [outputs]")
        return self


def load_map(file: Path, fmu: FmuSummary) -> FmuMap:
    """Read a map (TOML) and check its variables against an FMU.

    Raises:
        FmuError: the file cannot be read, has an unknown key or a wrong value, or names a variable
            that the FMU does not have or that cannot be used so; place, value and remedy are named.
    """
    try:
        mapping = FmuMap.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError) as error:
        raise FmuError(f"{file}: the map cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise FmuError(f"{file}: the map is not TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the map"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise FmuError(f"{file}: {place}: {first['msg']}; got {first['input']!r}{more}") from error
    _check_variables(file, mapping, fmu)
    return mapping


def _check_variables(file: Path, mapping: FmuMap, fmu: FmuSummary) -> None:
    numbers = {v.name: v for v in fmu.variables if v.scalar and v.type not in ("String", "Binary")}
    for tag, entry in mapping.inputs.items():
        found = numbers.get(entry.variable)
        inputs = [
            name
            for name, v in numbers.items()
            if v.causality == "input" or (v.causality == "parameter" and v.variability == "tunable")
        ]
        if found is None or entry.variable not in inputs:
            why = (
                "does not exist" if found is None else f"is {found.causality} and cannot be written"
            )
            raise FmuError(
                f"{file}: inputs.{tag}: variable {entry.variable!r} {why}; "
                f"{nearest(entry.variable, inputs)}"
            )
    for tag, out in mapping.outputs.items():
        if out.variable not in numbers:
            raise FmuError(
                f"{file}: outputs.{tag}: variable {out.variable!r} does not exist; "
                f"{nearest(out.variable, numbers)}"
            )
    settable = [v.name for v in fmu.variables if v.settable and v.type != "Binary"]
    for name in mapping.parameters:
        if name not in settable:
            raise FmuError(
                f"{file}: parameters: {name!r} does not exist or cannot be set before the start; "
                f"{nearest(name, settable)}"
            )
