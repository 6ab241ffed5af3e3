"""What a description says of units and FMPy does not read: differences and inverse units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .archive import read_root

__all__ = ["UnitDetails", "read_unit_details"]

_TRUE = ("true", "1")


@dataclass(frozen=True, slots=True)
class UnitDetails:
    """Details of units.

    Attributes:
        relative: by variable that says so, whether it is a difference, whose unit converts without
            its offset; what it does not say, its declared type does.
        inverse: unit and display unit of which one is a number divided by the other (FMI 3).
    """

    relative: dict[str, bool]
    inverse: frozenset[tuple[str, str]]


def read_unit_details(file: Path) -> UnitDetails:
    """Return what the description of an FMU says.

    Args:
        file: an FMU whose description can be read.
    """
    root = read_root(file)
    relative = {}
    for element in root.iterfind("ModelVariables//*[@relativeQuantity]"):
        # FMI 1 and 2 have the type's attributes in an element of their own.
        name = element.get("name") or element.getparent().get("name")
        relative[name] = element.get("relativeQuantity") in _TRUE
    inverse = {
        (str(shown.getparent().get("name")), str(shown.get("name")))
        for shown in root.iterfind("UnitDefinitions/Unit/DisplayUnit")
        if shown.get("inverse") in _TRUE
    }
    return UnitDetails(relative, frozenset(inverse))
