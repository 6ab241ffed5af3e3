"""What happens to a value between two ends of a connection, or between a parameter and its target.

SSP 1.0 knows four transformations: a linear one, and tables for booleans, integers and the items of
enumerations. A connection through several systems does one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from lxml import etree

from .errors import PlantInputError

__all__ = ["Change", "Linear", "Table", "apply_changes", "read_transformation"]

_TRUTH = {"true": 1.0, "1": 1.0, "false": 0.0, "0": 0.0}


@dataclass(frozen=True, slots=True)
class Linear:
    """``factor * value + offset``."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the value at the other end."""
        return self.factor * value + self.offset

    def invert(self, value: float) -> float | None:
        """Return the input that is changed into ``value``; None where all inputs give one value."""
        return (value - self.offset) / self.factor if self.factor else None


@dataclass(frozen=True, slots=True)
class Table:
    """A conversion by a list of values; a value that is not in the list is refused.

    Attributes:
        entries: pairs of source and target.
        where: what it belongs to, for the message.
    """

    entries: Mapping[float, float]
    where: str

    def __call__(self, value: float) -> float:
        """Return the value at the other end.

        Raises:
            PlantInputError: the table has no such source.
        """
        found = self.entries.get(value)
        if found is None:
            known = ", ".join(f"{source:g}" for source in self.entries)
            raise PlantInputError(
                f"{self.where}: its mapping has no entry for {value:g}, only for {known}"
            )
        return found

    def invert(self, value: float) -> float | None:
        """Return the first source of ``value``; None without one."""
        return next((source for source, target in self.entries.items() if target == value), None)


Change = Linear | Table


def apply_changes(changes: tuple[Change, ...], value: float) -> float:
    """Return ``value`` after all ``changes``, in their order."""
    for change in changes:
        value = change(value)
    return value


def read_transformation(
    element: Any,
    where: str,
    from_item: Callable[[str], float],
    to_item: Callable[[str], float],
) -> Change | None:
    """Return the transformation inside an XML element; None without one.

    Args:
        element: a connection or an entry of a mapping.
        where: of the element, for messages.
        from_item: gives the number of an enumeration's item at the source.
        to_item: the same at the target.
    """
    for child in element:
        kind = etree.QName(child).localname
        if kind == "LinearTransformation":
            return Linear(float(child.get("factor", 1.0)), float(child.get("offset", 0.0)))
        pairs = [(entry.get("source"), entry.get("target")) for entry in child]
        if kind == "BooleanMappingTransformation":
            return Table({_TRUTH[a]: _TRUTH[b] for a, b in pairs}, where)
        if kind == "IntegerMappingTransformation":
            return Table({float(a): float(b) for a, b in pairs}, where)
        if kind == "EnumerationMappingTransformation":
            return Table({from_item(a): to_item(b) for a, b in pairs}, where)
    return None
