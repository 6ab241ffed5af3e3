"""Convert between the unit of a tag and the unit of an FMU's variable.

An FMU defines its units by factor and offset to SI (FMI 2, 2.2.2); where a map names a unit that
the FMU does not define, the units of process plants below help out. Only units of one dimension
convert.
"""

from __future__ import annotations

from dataclasses import dataclass

from fieldlink.lab.fmu.errors import FmuError, nearest
from fmu_models import FmuSummary

__all__ = ["Conversion", "conversion"]

# Exponents of kg, m, s, A, K, mol, cd, rad.
_ONE = (0, 0, 0, 0, 0, 0, 0, 0)
_LENGTH = (0, 1, 0, 0, 0, 0, 0, 0)
_TIME = (0, 0, 1, 0, 0, 0, 0, 0)
_PRESSURE = (1, -1, -2, 0, 0, 0, 0, 0)
_TEMPERATURE = (0, 0, 0, 0, 1, 0, 0, 0)
_VOLUME = (0, 3, 0, 0, 0, 0, 0, 0)
_FLOW = (0, 3, -1, 0, 0, 0, 0, 0)
_MASS_FLOW = (1, 0, -1, 0, 0, 0, 0, 0)
_SPEED = (0, 1, -1, 0, 0, 0, 0, 0)
_ANGULAR = (0, 0, -1, 0, 0, 0, 0, 1)
_POWER = (1, 2, -3, 0, 0, 0, 0, 0)
_FORCE = (1, 1, -2, 0, 0, 0, 0, 0)

_Unit = tuple[tuple[int, ...], float, float]
_COMMON: dict[str, _Unit] = {
    "1": (_ONE, 1.0, 0.0),
    "%": (_ONE, 0.01, 0.0),
    "m": (_LENGTH, 1.0, 0.0),
    "cm": (_LENGTH, 1e-2, 0.0),
    "mm": (_LENGTH, 1e-3, 0.0),
    "s": (_TIME, 1.0, 0.0),
    "min": (_TIME, 60.0, 0.0),
    "h": (_TIME, 3600.0, 0.0),
    "Pa": (_PRESSURE, 1.0, 0.0),
    "kPa": (_PRESSURE, 1e3, 0.0),
    "MPa": (_PRESSURE, 1e6, 0.0),
    "mbar": (_PRESSURE, 1e2, 0.0),
    "bar": (_PRESSURE, 1e5, 0.0),
    "psi": (_PRESSURE, 6894.757293168361, 0.0),
    "K": (_TEMPERATURE, 1.0, 0.0),
    "degC": (_TEMPERATURE, 1.0, 273.15),
    "degF": (_TEMPERATURE, 5.0 / 9.0, 459.67 * 5.0 / 9.0),
    "m3": (_VOLUME, 1.0, 0.0),
    "l": (_VOLUME, 1e-3, 0.0),
    "m3/s": (_FLOW, 1.0, 0.0),
    "m3/h": (_FLOW, 1.0 / 3600.0, 0.0),
    "l/s": (_FLOW, 1e-3, 0.0),
    "l/min": (_FLOW, 1e-3 / 60.0, 0.0),
    "kg/s": (_MASS_FLOW, 1.0, 0.0),
    "kg/h": (_MASS_FLOW, 1.0 / 3600.0, 0.0),
    "t/h": (_MASS_FLOW, 1000.0 / 3600.0, 0.0),
    "m/s": (_SPEED, 1.0, 0.0),
    "rad/s": (_ANGULAR, 1.0, 0.0),
    "rpm": (_ANGULAR, 0.10471975511965977, 0.0),
    "W": (_POWER, 1.0, 0.0),
    "kW": (_POWER, 1e3, 0.0),
    "MW": (_POWER, 1e6, 0.0),
    "N": (_FORCE, 1.0, 0.0),
}


@dataclass(frozen=True, slots=True)
class Conversion:
    """``variable = scale * tag + offset``: from the unit of a tag to that of a variable."""

    scale: float = 1.0
    offset: float = 0.0

    def to_variable(self, value: float) -> float:
        """Convert a tag's value to the variable's unit."""
        return self.scale * value + self.offset

    def to_tag(self, value: float) -> float:
        """Convert a variable's value to the tag's unit."""
        return (value - self.offset) / self.scale


def conversion(fmu: FmuSummary, variable: str, unit: str | None) -> Conversion:
    """Return how a tag in ``unit`` becomes a value of ``variable``; None means no conversion.

    Raises:
        FmuError: the variable has no unit, a unit is not known, or the dimensions differ.
    """
    found = fmu.variable(variable)
    if unit is None or found is None or unit == found.unit:
        return Conversion()
    if not found.unit:
        raise FmuError(
            f"{fmu.file.name}: variable {variable} has no unit, so it cannot be converted to "
            f"{unit!r}; leave the unit out of the map"
        )
    known = _units(fmu)
    for name in (unit, found.unit):
        if name not in known:
            raise FmuError(
                f"{fmu.file.name}: unit {name!r} of {variable} is not known; {nearest(name, known)}"
            )
    dimension, factor, offset = known[unit]
    own_dimension, own_factor, own_offset = known[found.unit]
    if dimension != own_dimension:
        raise FmuError(
            f"{fmu.file.name}: {variable} is in {found.unit!r}, which is another quantity than "
            f"{unit!r}; correct the unit in the map"
        )
    # A difference has no zero point: 10 K more are 10 degC more.
    shift = 0.0 if found.relative else offset - own_offset
    return Conversion(factor / own_factor, shift / own_factor)


def _units(fmu: FmuSummary) -> dict[str, _Unit]:
    """Return the units that can be named: the FMU's own win over the common ones."""
    units = dict(_COMMON)
    for own in fmu.units:
        if own.dimension:
            units[own.name] = (own.dimension, own.factor, own.offset)
        if own.name not in units:
            continue
        dimension, factor, offset = units[own.name]
        for name, scale, shift in own.shown:
            # shown = scale * value + shift, SI = factor * value + offset
            units[name] = (dimension, factor / scale, offset - factor * shift / scale)
    return units
