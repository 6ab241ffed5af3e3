"""Read a system of FMUs, an ``.ssp`` archive of SSP 1.0 (System Structure and Parameterization).

FMPy checks the schema and reads parameter values and mappings. Connections are read here, because
FMPy drops their transformations and the connectors' units. Systems inside systems are flattened:
what stays is, for every input of every component, the output or system input that feeds it.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fmpy.ssp import ssd as reader
from lxml import etree

from .archive import MAX_ENTRIES, MAX_EXTRACTED_BYTES
from .errors import PlantFileError

__all__ = ["Link", "SystemStructure", "read_system"]

_NS = reader.ns
_Node = tuple[str, str]  # path of the element, connector


@dataclass(frozen=True, slots=True)
class Link:
    """Where a value comes from: ``value = factor * source + offset``.

    ``component`` is empty for an input of the whole system.
    """

    component: str
    name: str
    factor: float = 1.0
    offset: float = 0.0

    def convert(self, value: float) -> float:
        """Return the value at this end of the connection."""
        return self.factor * value + self.offset


@dataclass(slots=True)
class SystemStructure:
    """A flattened system.

    Attributes:
        file: the archive.
        name: of the system.
        sources: by component (``sub.valve`` inside a system ``sub``), its FMU in the archive.
        parameters: by component, start values.
        links: by component and input, what feeds it.
        inputs: of the whole system, with units.
        outputs: of the whole system, what feeds them.
        start, stop: of the default experiment in seconds, None where not given.
    """

    file: Path
    name: str
    sources: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    links: dict[str, dict[str, Link]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, Link] = field(default_factory=dict)
    start: float | None = None
    stop: float | None = None

    def order(self) -> list[str]:
        """Return the components in the order in which they step.

        A component comes after those that feed it; a loop is begun by the one that is named first.
        """
        left, placed = list(self.sources), []
        while left:
            ready = (
                c
                for c in left
                if all(
                    link.component not in left or link.component == c
                    for link in self.links.get(c, {}).values()
                )
            )
            chosen = next(ready, left[0])
            left.remove(chosen)
            placed.append(chosen)
        return placed


def read_system(file: Path) -> SystemStructure:
    """Read and flatten a system; nothing of its FMUs is run.

    Raises:
        PlantFileError: no SSP archive, not valid, or it uses what is not supported; the place and
            the reason are named.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
            if (
                sum(e.file_size for e in entries) > MAX_EXTRACTED_BYTES
                or len(entries) > MAX_ENTRIES
            ):
                raise PlantFileError(f"{file}: it would extract to more than 1024 MB")
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            root = etree.fromstring(archive.read("SystemStructure.ssd"), parser)
    except (OSError, KeyError, zipfile.BadZipFile, etree.XMLSyntaxError) as error:
        why = error.args[0] if error.args else error
        raise PlantFileError(
            f"{file}: it is not an SSP archive (a zip file with SystemStructure.ssd): {why}"
        ) from error
    try:
        reader.validate_tree(root, "SystemStructureDescription.xsd")
    except Exception as error:  # FMPy raises nothing narrower
        found = [line for line in str(error).splitlines() if line.startswith(("ERROR", "FATAL"))]
        what = found[0] if found else str(error)
        raise PlantFileError(f"{file}: SystemStructure.ssd is not valid SSP 1.0: {what}") from error
    system = root.find("ssd:System", _NS)
    structure = SystemStructure(file, system.get("name") or root.get("name"))
    experiment = root.find("ssd:DefaultExperiment", _NS)
    if experiment is not None:
        structure.start = _number(experiment.get("startTime"))
        structure.stop = _number(experiment.get("stopTime"))
    _Flattener(structure, _units(root)).run(system)
    return structure


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)


def _units(root: Any) -> dict[str, tuple[tuple[int, ...], float, float]]:
    units = {}
    for unit in root.findall("ssd:Units/ssc:Unit", _NS):
        base = unit.find("ssc:BaseUnit", _NS)
        dimension = tuple(
            int(base.get(n, 0)) for n in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
        )
        factor, offset = float(base.get("factor", 1.0)), float(base.get("offset", 0.0))
        units[unit.get("name")] = (dimension, factor, offset)
    return units


class _Flattener:
    def __init__(
        self,
        structure: SystemStructure,
        units: Mapping[str, tuple[tuple[int, ...], float, float]],
    ) -> None:
        self._to = structure
        self._units = units
        self._kinds: dict[_Node, str] = {}
        self._unit_of: dict[_Node, str] = {}
        self._edges: dict[_Node, tuple[_Node, float, float]] = {}

    def run(self, system: Any) -> None:
        self._walk(system, "")
        for component in self._to.sources:
            found = {}
            for (path, name), kind in self._kinds.items():
                if path == component and kind in ("input", "parameter"):
                    link = self._source_of((path, name))
                    if link is not None:
                        found[name] = link
            self._to.links[component] = found
        for (path, name), kind in self._kinds.items():
            if path == "" and kind == "input":
                self._to.inputs[name] = self._unit_of.get((path, name), "")
            elif path == "" and kind == "output":
                link = self._source_of((path, name))
                if link is not None:
                    self._to.outputs[name] = link

    def _fail(self, where: str, what: str) -> PlantFileError:
        return PlantFileError(f"{self._to.file}: {where or self._to.name}: {what}")

    def _walk(self, system: Any, path: str) -> None:
        self._connectors(system, path)
        self._bind(system, path, is_component=False)
        for element in system.findall("ssd:Elements/*", _NS):
            inner = f"{path}.{element.get('name')}" if path else element.get("name")
            tag = etree.QName(element).localname
            if tag == "System":
                self._walk(element, inner)
            elif tag == "Component":
                source = element.get("source") or ""
                if not source.lower().endswith(".fmu") or ":" in source:
                    raise self._fail(
                        inner, f"its source {source!r} is no FMU inside the archive; put it there"
                    )
                self._to.sources[inner] = source
                self._connectors(element, inner)
                self._bind(element, inner, is_component=True)
            else:
                raise self._fail(inner, f"a {tag} is not supported; replace it by connections")
        for connection in system.findall("ssd:Connections/ssd:Connection", _NS):
            self._connect(connection, path)

    def _connectors(self, element: Any, path: str) -> None:
        for connector in element.findall("ssd:Connectors/ssd:Connector", _NS):
            node = (path, connector.get("name"))
            self._kinds[node] = connector.get("kind")
            real = connector.find("ssc:Real", _NS)
            if real is not None and real.get("unit"):
                self._unit_of[node] = real.get("unit")

    def _connect(self, connection: Any, path: str) -> None:
        ends = []
        for side in ("start", "end"):
            element, name = connection.get(f"{side}Element"), connection.get(f"{side}Connector")
            place = path if element is None else f"{path}.{element}" if path else element
            node = (place, name)
            if node not in self._kinds:
                raise self._fail(place, f"a connection names a connector {name!r}, there is none")
            gives = self._kinds[node] == ("input" if element is None else "output")
            ends.append((node, gives))
        (start, gives), (end, takes_not) = ends
        if gives == takes_not:
            raise self._fail(path, f"the connection of {start[1]} and {end[1]} has no direction")
        source, sink = (start, end) if gives else (end, start)
        if sink in self._edges:
            raise self._fail(sink[0], f"{sink[1]} is connected twice")
        factor, offset = self._unit_change(source, sink, connection)
        change = connection.find("ssc:LinearTransformation", _NS)
        if change is not None:
            scale, shift = float(change.get("factor", 1.0)), float(change.get("offset", 0.0))
            factor, offset = scale * factor, scale * offset + shift
        others = [c for c in connection if "Mapping" in etree.QName(c).localname]
        if others:
            name = etree.QName(others[0]).localname
            raise self._fail(path, f"{name} of {source[1]} is not supported")
        self._edges[sink] = (source, factor, offset)

    def _unit_change(self, source: _Node, sink: _Node, connection: Any) -> tuple[float, float]:
        there, here = self._unit_of.get(source), self._unit_of.get(sink)
        suppressed = connection.get("suppressUnitConversion") == "true"
        if there is None or here is None or there == here or suppressed:
            return 1.0, 0.0
        if there not in self._units or here not in self._units:
            raise self._fail(
                sink[0], f"{sink[1]} is in {here!r} and {source[1]} in {there!r}; define both units"
            )
        dimension, factor, offset = self._units[there]
        other, to_factor, to_offset = self._units[here]
        if dimension != other:
            raise self._fail(
                sink[0], f"{sink[1]} in {here!r} and {source[1]} in {there!r} are other quantities"
            )
        return factor / to_factor, (offset - to_offset) / to_factor

    def _source_of(self, node: _Node) -> Link | None:
        factor, offset = 1.0, 0.0
        while node in self._edges:
            node, scale, shift = self._edges[node]
            factor, offset = factor * scale, factor * shift + offset
            if node[0] in self._to.sources:
                return Link(node[0], node[1], factor, offset)
        is_system_input = node[0] == "" and self._kinds[node] == "input"
        return Link("", node[1], factor, offset) if is_system_input else None

    def _bind(self, element: Any, path: str, *, is_component: bool) -> None:
        for binding in element.findall("ssd:ParameterBindings/ssd:ParameterBinding", _NS):
            prefix = binding.get("prefix") or ""
            for name, value in self._bound(binding, path).items():
                whole = prefix + name
                if not is_component and "." not in whole:
                    raise self._fail(path, f"parameter {whole!r} names no component")
                inner, _, variable = ("", "", whole) if is_component else whole.rpartition(".")
                component = path if is_component else f"{path}.{inner}" if path else inner
                self._to.parameters.setdefault(component, {})[variable] = value

    def _bound(self, binding: Any, path: str) -> dict[str, float]:
        source, file = binding.get("source"), str(self._to.file)
        mapping = binding.find("ssd:ParameterMapping", _NS)
        try:
            if source is not None:
                sets = [reader.read_ssv(file, resource=source)]
            else:
                inline = binding.findall("ssd:ParameterValues/ssv:ParameterSet", _NS)
                sets = [reader._get_parameter_set(one) for one in inline]
            entries = None
            if mapping is not None and mapping.get("source"):
                entries = reader.read_ssm(file, resource=mapping.get("source")).mappingEntries
        except Exception as error:  # FMPy raises nothing narrower
            raise self._fail(path, f"its parameters cannot be read: {error}") from error
        if mapping is not None and entries is None:
            raise self._fail(path, "a mapping inside the file is not supported; put it in an .ssm")
        words = {"true": "1", "false": "0"}
        found = {}
        for parameter in (p for one in sets for p in one.parameters):
            try:
                found[parameter.name] = float(words.get(parameter.value, parameter.value))
            except (TypeError, ValueError):
                raise self._fail(path, f"parameter {parameter.name} is not a number") from None
        if entries is None:
            return found
        mapped = {}
        for entry in entries:
            if entry.source in found:
                change = entry.transformation
                scale = float(change.factor) if change is not None else 1.0
                shift = float(change.offset) if change is not None else 0.0
                mapped[entry.target] = scale * found[entry.source] + shift
        return mapped
