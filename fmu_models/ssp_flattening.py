"""Flatten systems inside systems: what feeds each input of each component, and its start values."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fmpy.ssp import ssd as reader
from lxml import etree

from .errors import PlantFileError, PlantInputError
from .ssp_changes import Change, Linear, read_transformation
from .ssp_dictionaries import SignalDictionaries
from .ssp_structure import Link, SystemStructure
from .ssp_values import Start, convert_unit, read_binding, read_units

__all__ = ["flatten"]

_NS = reader.ns
_Node = tuple[str, str]  # path of the element, connector


def flatten(root: Any, structure: SystemStructure) -> None:
    """Put sources, links and start values of a whole system into ``structure``.

    Args:
        root: of ``SystemStructure.ssd``, checked against the schema.
        structure: with the archive's path and the system's name.

    Raises:
        PlantFileError: it uses what is not supported; the place and the reason are named.
    """
    _Flattener(root, structure).run(root.find("ssd:System", _NS))


class _Flattener:
    def __init__(self, root: Any, structure: SystemStructure) -> None:
        self._to = structure
        self._units = read_units(root)
        self._enumerations: dict[str, dict[str, float]] = {
            found.get("name"): {
                item.get("name"): float(item.get("value"))
                for item in found.iterfind("ssc:Item", _NS)
            }
            for found in root.iterfind("ssd:Enumerations/ssc:Enumeration", _NS)
        }
        self._kinds: dict[_Node, str] = {}
        self._unit_of: dict[_Node, str] = {}
        self._enumeration_of: dict[_Node, str] = {}
        self._edges: dict[_Node, tuple[_Node, tuple[Change, ...]]] = {}
        self._systems: list[str] = []
        self._given: list[tuple[str, dict[str, Start]]] = []
        self._dictionaries = SignalDictionaries(structure.file)
        self._entries: set[_Node] = set()
        self._references: dict[str, str] = {}
        self._elements: set[str] = {""}

    def run(self, system: Any) -> None:
        to = self._to
        self._walk(system, "")
        if not to.sources:
            raise self._fail("", "it has no component, so there is nothing to run")
        to.unit_of |= {
            node: self._units[unit] for node, unit in self._unit_of.items() if unit in self._units
        }
        self._place_starts()
        for component in to.sources:
            to.links[component], to.parameter_links[component] = {}, {}
        for (path, name), kind in self._kinds.items():
            if path in to.sources and kind in ("input", "parameter"):
                link = self._source_of((path, name))
                if link is not None:
                    known = to.links if kind == "input" else to.parameter_links
                    known[path][name] = link
            elif path == "" and kind == "input":
                to.inputs[name] = self._unit_of.get((path, name), "")
            elif path == "" and kind == "output":
                link = self._source_of((path, name))
                if link is not None:
                    to.outputs[name] = link
        used = {link.name for links in to.parameter_links.values() for link in links.values()}
        to.parameters = tuple(n for (p, n) in self._kinds if p == "" and n in used)

    def _fail(self, where: str, what: str) -> PlantFileError:
        return PlantFileError(f"{self._to.file}: {where or self._to.name}: {what}")

    def _walk(self, system: Any, path: str) -> None:
        self._systems.append(path)
        self._connectors(system, path)
        self._bind(system, path, None)
        for dictionary in system.findall("ssd:SignalDictionaries/ssd:SignalDictionary", _NS):
            try:
                entries = self._dictionaries.add(path, dictionary)
            except ValueError as error:
                raise self._fail(path, str(error)) from error
            self._entries |= set(entries)
            self._unit_of |= {node: unit for node, unit in entries.items() if unit}
        for element in system.findall("ssd:Elements/*", _NS):
            inner = f"{path}.{element.get('name')}" if path else element.get("name")
            if inner in self._elements:
                raise self._fail(inner, "two elements have this name; rename one")
            self._elements.add(inner)
            tag = etree.QName(element).localname
            if tag == "System":
                self._walk(element, inner)
            elif tag == "Component":
                source = element.get("source") or ""
                if not source.lower().endswith(".fmu") or ":" in source:
                    raise self._fail(
                        inner, f"its source {source!r} is not an FMU in the archive; put it there"
                    )
                self._to.sources[inner] = source
                self._connectors(element, inner)
                self._bind(element, inner, source)
            else:
                self._connectors(element, inner)
                try:
                    place = self._dictionaries.look_up(path, element.get("dictionary"))
                except ValueError as error:
                    raise self._fail(inner, str(error)) from error
                self._references[inner] = place
        for connection in system.findall("ssd:Connections/ssd:Connection", _NS):
            self._connect(connection, path)

    def _connectors(self, element: Any, path: str) -> None:
        for connector in element.findall("ssd:Connectors/ssd:Connector", _NS):
            node = (path, connector.get("name"))
            self._kinds[node] = connector.get("kind")
            for declared in connector.iterfind("ssc:*", _NS):
                if declared.get("unit"):
                    self._unit_of[node] = declared.get("unit")
                if etree.QName(declared).localname == "Enumeration":
                    self._enumeration_of[node] = declared.get("name")

    def _connect(self, connection: Any, path: str) -> None:
        ends: list[tuple[_Node, bool | None]] = []
        for side in ("start", "end"):
            element, name = connection.get(f"{side}Element"), connection.get(f"{side}Connector")
            place = path if element is None else f"{path}.{element}" if path else element
            node = (place, name)
            if place not in self._elements:
                raise self._fail(path, f"a connection names an element {place!r}, there is none")
            if node not in self._kinds:
                raise self._fail(place, f"a connection names a connector {name!r}, there is none")
            own = self._kinds[node] in ("input", "parameter")
            direction = own if element is None else not own
            either = place in self._references and self._kinds[node] == "inout"
            ends.append((self._shared(node), None if either else direction))
        (start, gives), (end, takes_not) = ends
        if gives is None and takes_not is not None:
            gives = not takes_not
        if gives is None or gives == takes_not:
            raise self._fail(path, f"the connection of {start[1]} and {end[1]} has no direction")
        source, sink = (start, end) if gives else (end, start)
        if sink in self._edges:
            raise self._fail(sink[0], f"{sink[1]} is connected twice")
        unit = self._unit_change(source, sink, connection)
        change = read_transformation(
            connection,
            f"system {self._to.name}: {'.'.join(filter(None, sink))}",
            self._items_of(source),
            self._items_of(sink),
        )
        self._edges[sink] = (source, tuple(c for c in (unit, change) if c is not None))

    def _shared(self, node: _Node) -> _Node:
        """Return the dictionary's entry for a node that refers to one, else the node itself."""
        place = self._references.get(node[0])
        if place is None:
            return node
        entry = (place, node[1])
        if entry not in self._entries:
            known = [name for where, name in sorted(self._entries) if where == place]
            raise self._fail(
                node[0], f"{place} has no entry {node[1]!r}, it has {', '.join(known) or 'none'}"
            )
        return entry

    def _items_of(self, node: _Node) -> Callable[[str], float]:
        return partial(self._item_number, node)

    def _item_number(self, node: _Node, item: str) -> float:
        """Return the number of an item of a connector's enumeration."""
        name = self._enumeration_of.get(node)
        if name is None or name not in self._enumerations:
            raise self._fail(
                node[0],
                f"the connector {node[1]} names no enumeration of the structure, so the item "
                f"{item!r} has no number; declare it in Enumerations and in the connector",
            )
        items = self._enumerations[name]
        if item not in items:
            raise self._fail(
                node[0], f"the enumeration {name} has no item {item!r}, it has {', '.join(items)}"
            )
        return items[item]

    def _unit_change(self, source: _Node, sink: _Node, connection: Any) -> Linear | None:
        there, here = self._unit_of.get(source), self._unit_of.get(sink)
        suppressed = connection.get("suppressUnitConversion") in ("true", "1")
        if there is None or here is None or there == here or suppressed:
            return None
        if there not in self._units or here not in self._units:
            raise self._fail(
                sink[0], f"{sink[1]} is in {here!r} and {source[1]} in {there!r}; define both units"
            )
        change = convert_unit(self._units[there], self._units[here])
        if change is None:
            raise self._fail(
                sink[0],
                f"{sink[1]} in {here!r} and {source[1]} in {there!r} are different quantities",
            )
        return change

    def _source_of(self, node: _Node) -> Link | None:
        changes: tuple[Change, ...] = ()
        while node in self._edges:
            node, before = self._edges[node]
            changes = before + changes
            if node[0] in self._to.sources:
                return Link(node[0], node[1], changes)
        is_systems = node[0] == "" and self._kinds[node] in ("input", "parameter")
        return Link("", node[1], changes) if is_systems else None

    def _bind(self, element: Any, path: str, source: str | None) -> None:
        """Collect the start values that are bound at one element; the later win."""
        found: dict[str, Start] = {}
        for binding in element.findall("ssd:ParameterBindings/ssd:ParameterBinding", _NS):
            try:
                found |= read_binding(binding, self._to.file, source, self._units)
            except ValueError as error:
                raise self._fail(path, f"its parameters cannot be read: {error}") from error
        self._given.append((path, found))

    def _place_starts(self) -> None:
        """Give each value to its component or system; those of outer systems win.

        They were collected from the outside to the inside.
        """
        for path, values in self._given:
            for name, start in values.items():
                owner, variable = self._owner(path, name)
                if owner is None:
                    self._to.ignored.append(f"{path}.{name}" if path else name)
                else:
                    self._to.starts.setdefault(owner, {}).setdefault(variable, start)
        for node in list(self._kinds):
            self._pass_on(node)

    def _owner(self, path: str, name: str) -> tuple[str | None, str]:
        """Return the component (or system) that a name belongs to, and the rest of the name."""
        if path in self._to.sources:
            return path, name
        whole = f"{path}.{name}" if path else name
        components = [c for c in self._to.sources if whole.startswith(f"{c}.")]
        if components:
            component = max(components, key=len)
            return component, whole[len(component) + 1 :]
        for system in sorted(self._systems, key=len, reverse=True):
            inner = whole[len(system) + 1 :] if system else whole
            if (not system or whole.startswith(f"{system}.")) and (system, inner) in self._kinds:
                return system, inner
        return None, whole

    def _pass_on(self, node: _Node) -> None:
        """Hand the start value of an inner system's connector on to what it feeds."""
        path, name = node
        if path not in self._to.sources or self._kinds[node] not in ("input", "parameter"):
            return
        changes: tuple[Change, ...] = ()
        while node in self._edges:
            node, before = self._edges[node]
            changes = before + changes
            start = self._to.starts.get(node[0], {}).get(node[1])
            if node[0] == "" or node[0] in self._to.sources:
                return
            if start is not None:
                unit = self._units.get(self._unit_of.get(node, ""))
                try:
                    after = start.pass_on(unit, changes)
                except PlantInputError as error:
                    raise self._fail(node[0], f"{node[1]}: {error}") from error
                self._to.starts.setdefault(path, {})[name] = after
                return
