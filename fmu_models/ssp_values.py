"""Parameter sets and mappings of SSP 1.0: start values by name, in the structure or beside it.

A binding gives values to the names of the system or component at which it stands. Where several
give the same name, the later one at a place wins over the earlier, and the one of a system wins
over those of what is inside it.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmpy.ssp import ssd as reader
from lxml import etree

from .errors import PlantInputError
from .ssp_changes import Change, Linear, apply_changes, read_transformation

__all__ = [
    "SiUnit",
    "Start",
    "Units",
    "convert_unit",
    "find_complaint",
    "read_binding",
    "read_units",
]

_NS = reader.ns
_TRUTH = {"true": 1.0, "1": 1.0, "false": 0.0, "0": 0.0}
SiUnit = tuple[tuple[int, ...], float, float]
"""Exponents of the SI base units, factor and offset to them."""
Units = Mapping[str, SiUnit]


@dataclass(frozen=True, slots=True)
class Start:
    """A start value.

    Attributes:
        value: a number, the name of an enumeration's item, or a text.
        unit: in which it is given; empty where the file names none.
        definition: of that unit; None where nothing defines it.
        changes: what the mapping does to it, after its unit was converted.
        is_text: whether it is the value of a string variable.
    """

    value: float | str
    unit: str = ""
    definition: SiUnit | None = None
    changes: tuple[Change, ...] = ()
    is_text: bool = False

    def text(self) -> str:
        """Return the text that the target takes.

        Raises:
            PlantInputError: it is a number, or an item of an enumeration.
        """
        if not self.is_text:
            raise PlantInputError(f"it takes text; the file gives {self.value}, no String")
        return str(self.value)

    def number(self, unit: SiUnit | None, items: Mapping[str, float]) -> float:
        """Return the number that the target takes.

        Args:
            unit: of the target; None where it has none.
            items: of the target's enumeration, their numbers by name.

        Raises:
            PlantInputError: a text, an item that the enumeration lacks, a unit of another quantity,
                or a mapping without an entry for the value.
        """
        value = self.value
        if self.is_text:
            raise PlantInputError(f"it takes a number; the file gives the text {value!r}")
        if isinstance(value, str):
            if value not in items:
                known = f"it has {', '.join(items)}" if items else "it is not an enumeration"
                raise PlantInputError(f"there is no item {value!r}, {known}")
            value = items[value]
        elif self.definition is not None and unit is not None:
            change = convert_unit(self.definition, unit)
            if change is None:
                raise PlantInputError(f"the unit {self.unit!r} is one of another quantity")
            value = change(value)
        return apply_changes(self.changes, value)

    def pass_on(self, unit: SiUnit | None, changes: tuple[Change, ...]) -> Start:
        """Return the value behind a connector in ``unit`` and the changes of its connection.

        Raises:
            PlantInputError: as `number` does; items of enumerations and texts pass as they are.
        """
        if isinstance(self.value, str):
            return self
        return Start(apply_changes(changes, self.number(unit, {})))


def read_units(root: Any) -> Units:
    """Return the units that a file of SSP defines."""
    units = {}
    for unit in root.iterfind("*/ssc:Unit", _NS):
        base = unit.find("ssc:BaseUnit", _NS)
        dimension = tuple(
            int(base.get(n, 0)) for n in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
        )
        units[unit.get("name")] = (
            dimension,
            float(base.get("factor", 1.0)),
            float(base.get("offset", 0.0)),
        )
    return units


def convert_unit(there: SiUnit, here: SiUnit) -> Linear | None:
    """Return what turns a value in one unit into another; None for other quantities."""
    if there[0] != here[0]:
        return None
    return Linear(there[1] / here[1], (there[2] - here[2]) / here[1])


def read_binding(
    binding: Any,
    archive: Path,
    component: str | None,
    known_units: Units,
) -> dict[str, Start]:
    """Return the start values of a ``ParameterBinding``, by the names they are meant for.

    Args:
        binding: the XML element.
        archive: the ``.ssp``.
        component: the FMU of the component inside the archive, for sources that lie in it.
        known_units: of the structure file.

    Raises:
        ValueError: a source that is not there or not valid; the message says which.
    """
    values = binding.find("ssd:ParameterValues/ssv:ParameterSet", _NS)
    if binding.get("source") is not None:
        values = _read_source(binding, archive, component, "SystemStructureParameterValues.xsd")
    if values is None:
        return {}
    prefix = binding.get("prefix") or ""
    units = {**known_units, **read_units(values)}
    found = {
        prefix + parameter.get("name"): _start(parameter, units)
        for parameter in values.iterfind("ssv:Parameters/ssv:Parameter", _NS)
    }
    mapping = binding.find("ssd:ParameterMapping", _NS)
    if mapping is None:
        return found
    if mapping.get("source") is not None:
        entries = _read_source(mapping, archive, component, "SystemStructureParameterMapping.xsd")
    else:
        entries = mapping.find("ssm:ParameterMapping", _NS)
    if entries is None:
        raise ValueError("a ParameterMapping has neither a source nor entries")
    return _mapped(found, entries)


def _read_source(element: Any, archive: Path, component: str | None, schema: str) -> Any:
    """Return the root of the file that an element names as its source."""
    source = element.get("source")
    try:
        with zipfile.ZipFile(archive) as outer:
            if element.get("sourceBase") == "component" and component is not None:
                with zipfile.ZipFile(io.BytesIO(outer.read(component))) as inner:
                    content = inner.read(source)
            else:
                content = outer.read(source)
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        root = etree.fromstring(content, parser)
        reader.validate_tree(root, schema)
    except KeyError:
        raise ValueError(f"{source} is not in the archive") from None
    except Exception as error:  # FMPy raises nothing narrower
        raise ValueError(f"{source} is not valid: {find_complaint(error)}") from error
    return root


def find_complaint(error: Exception) -> str:
    """Return the first complaint of a schema's validation, or the error's own words."""
    lines = str(error).splitlines()
    found = [line for line in lines if line.startswith(("ERROR", "FATAL"))]
    return re.sub(r"\{[^}]*\}", "", found[0] if found else str(error))


def _start(parameter: Any, units: Units) -> Start:
    for child in parameter:
        kind = etree.QName(child).localname
        text = child.get("value")
        if kind in ("Real", "Integer"):
            unit = child.get("unit") or ""
            return Start(float(text), unit, units.get(unit))
        if kind == "Boolean":
            return Start(_TRUTH[text])
        if kind == "Enumeration":
            return Start(str(text))
        if kind == "String":
            return Start(text or "", is_text=True)
    raise ValueError(
        f"parameter {parameter.get('name')} is binary data, which cannot be set; leave it out"
    )


def _mapped(values: Mapping[str, Start], entries: Any) -> dict[str, Start]:
    found = {}
    for entry in entries.iterfind("ssm:MappingEntry", _NS):
        given = values.get(entry.get("source"))
        if given is None:
            continue
        if entry.get("suppressUnitConversion") in ("true", "1"):
            given = replace(given, unit="", definition=None)
        found[entry.get("target")] = _transformed(given, entry)
    return found


def _transformed(given: Start, entry: Any) -> Start:
    name = entry.get("source")

    def refuse(item: str) -> float:
        raise ValueError(f"the mapping of {name} is one of items such as {item}, its value is not")

    if given.is_text:
        if len(entry):
            raise ValueError(f"the mapping of {name} transforms a text; remove the transformation")
        return given
    if isinstance(given.value, str):
        words = entry.find("ssc:EnumerationMappingTransformation", _NS)
        if words is None:
            return given
        table = {one.get("source"): one.get("target") for one in words}
        if given.value not in table:
            known = ", ".join(table)
            raise ValueError(
                f"the mapping of {name} has no entry for {given.value}, only for {known}"
            )
        return replace(given, value=table[given.value])
    change = read_transformation(entry, f"parameter {name}", refuse, refuse)
    return given if change is None else replace(given, changes=(change,))
