"""The address space: folders of loops and devices, kept up to date.

Objects
    DI:DeviceSet        every valve and every device, for clients that look there
    Loops               one object a loop: its valve
    Devices             the connections
    UpdatedAt           when the daemon last gave values
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from asyncua import Server, ua

from fieldlink.opcua_server.names import (
    DEVICE_HEALTH,
    DEVICE_HEALTH_NAMES,
    DEVICE_SET,
    DEVICE_VARIABLES,
    DI,
    HEALTH_STRINGS,
    LOOP_VARIABLES,
    PADIM,
    Entry,
)

__all__ = ["Nodes"]

_EMPTY: Mapping[str, Any] = {
    "Boolean": False,
    "DateTime": datetime(1970, 1, 1, tzinfo=UTC),
    "DeviceHealth": 0,
    "Double": 0.0,
    "LocalizedText": ua.LocalizedText(""),
    "String": "",
    "UInt32": 0,
}


class Nodes:
    """The nodes of one server; its namespace 1 holds all that is ours.

    Args:
        server: asyncua's server, initialised.
    """

    def __init__(self, server: Server) -> None:
        self._server = server
        self._namespaces: dict[str, int] = {"": 1}
        self._health: Any = None
        self._device_set: Any = None
        self._folders: dict[str, Any] = {}
        self._shown: dict[tuple[str, str], dict[str, Any]] = {}
        self._out_of_sight: set[tuple[str, str]] = set()

    async def build(self) -> None:
        """Make the folders and what the companion specification needs."""
        for uri in (DI, PADIM):
            self._namespaces[uri] = await self._server.register_namespace(uri)
        di = self._namespaces[DI]
        objects = self._server.nodes.objects
        self._health = await self._server.nodes.enum_data_type.add_data_type(
            ua.NodeId(DEVICE_HEALTH, di), ua.QualifiedName("DeviceHealthEnumeration", di)
        )
        await self._health.add_property(
            ua.NodeId(HEALTH_STRINGS, di),
            ua.QualifiedName("EnumStrings"),
            [ua.LocalizedText(name) for name in DEVICE_HEALTH_NAMES],
        )
        self._device_set = await objects.add_folder(
            ua.NodeId(DEVICE_SET, di), ua.QualifiedName("DeviceSet", di)
        )
        for name in ("Loops", "Devices"):
            self._folders[name] = await objects.add_folder(
                ua.NodeId(name, 1), ua.QualifiedName(name, 1)
            )
        await self._add_variable(
            objects,
            "UpdatedAt",
            Entry("UpdatedAt", "DateTime", "When the daemon last gave values, every few seconds."),
        )

    async def show(self, document: Mapping[str, Any]) -> None:
        """Take over what has changed.

        Args:
            document: ``loops`` and ``devices``, each with ``names``, all that there are, and
                ``changed``, the values of those that are new or have changed.
        """
        for folder, entries in (("Loops", LOOP_VARIABLES), ("Devices", DEVICE_VARIABLES)):
            part = document[folder.lower()]
            await self._drop(folder, part["names"])
            for name, values in part["changed"].items():
                await self._update(folder, name, entries, values)
        await self._write("UpdatedAt", _data("DateTime", document["time"], document["time"]))

    @property
    def out_of_sight(self) -> int:
        """Objects whose nodes stay although the site does not have them any more."""
        return len(self._out_of_sight)

    async def _drop(self, folder: str, names: Sequence[str]) -> None:
        """Take out of sight the objects that the site does not have any more.

        Their nodes stay, with a bad status, which tells subscribed clients: asyncua tells them
        nothing of a node that is deleted, and stands still for a second over each such loop.
        """
        kept = set(names)
        entries = LOOP_VARIABLES if folder == "Loops" else DEVICE_VARIABLES
        for known in [known for known in self._shown if known[0] == folder]:
            if known[1] in kept:
                continue
            for entry in entries:
                gone = _bad(ua.StatusCodes.BadNodeIdUnknown)
                await self._write(_id_of(*known, entry.name), gone)
                if entry.signal:
                    await self._write(_id_of(*known, *entry.alias), gone)
            node = ua.NodeId(_id_of(*known), 1)
            for parent in (self._folders[folder], self._device_set):
                await parent.delete_reference(node, ua.ObjectIds.Organizes)
            del self._shown[known]
            self._out_of_sight.add(known)

    async def _update(
        self, folder: str, name: str, entries: Sequence[Entry], values: Mapping[str, Any]
    ) -> None:
        shown = self._shown.get((folder, name))
        if shown is None:
            shown = self._shown[folder, name] = {}
            if (folder, name) in self._out_of_sight:
                self._out_of_sight.discard((folder, name))
                node = ua.NodeId(_id_of(folder, name), 1)
                for parent in (self._folders[folder], self._device_set):
                    await parent.add_reference(node, ua.ObjectIds.Organizes)
            else:
                await self._add_object(folder, name, entries)
        judged = values.get("JudgedAt")
        for entry in entries:
            value = values[entry.name]
            moment = judged if entry.judged else None
            if entry.name in shown and shown[entry.name] == (value, moment):
                continue
            shown[entry.name] = (value, moment)
            data = _data(entry.kind, value, moment)
            await self._write(_id_of(folder, name, entry.name), data)
            if entry.signal:
                await self._write(_id_of(folder, name, *entry.alias), data)

    async def _add_object(self, folder: str, name: str, entries: Sequence[Entry]) -> None:
        node = await self._folders[folder].add_object(
            ua.NodeId(_id_of(folder, name), 1), ua.QualifiedName(name, 1)
        )
        await self._device_set.add_reference(node, ua.ObjectIds.Organizes)
        for entry in entries:
            await self._add_variable(node, _id_of(folder, name, entry.name), entry)
        signals = [entry for entry in entries if entry.signal]
        if signals:
            await self._add_signals(node, (folder, name), signals)

    async def _add_signals(self, parent: Any, path: tuple[str, ...], signals: list[Entry]) -> None:
        """Add the values that a client of PA-DIM looks for in a device's SignalSet."""
        padim = self._namespaces[PADIM]
        signal_set = await parent.add_object(
            ua.NodeId(_id_of(*path, "SignalSet"), 1), ua.QualifiedName("SignalSet", padim)
        )
        for entry in signals:
            below = (*path, *entry.alias[:-1])
            node = await signal_set.add_object(
                ua.NodeId(_id_of(*below), 1), ua.QualifiedName(entry.name, 1)
            )
            await node.add_property(
                ua.NodeId(_id_of(*below, "SignalTag"), 1),
                ua.QualifiedName("SignalTag", padim),
                f"{path[-1]}.{entry.name}",
            )
            value = Entry("AnalogSignal", entry.kind, entry.text, PADIM)
            await self._add_variable(node, _id_of(*path, *entry.alias), value)

    async def _add_variable(self, parent: Any, identifier: str, entry: Entry) -> None:
        if entry.kind == "DeviceHealth":
            kind, datatype = ua.VariantType.Int32, self._health.nodeid
        else:
            kind, datatype = ua.VariantType[entry.kind], None
        node = await parent.add_variable(
            ua.NodeId(identifier, 1),
            ua.QualifiedName(entry.name, self._namespaces[entry.namespace]),
            _EMPTY[entry.kind],
            varianttype=kind,
            datatype=datatype,
        )
        description = ua.Variant(ua.LocalizedText(entry.text), ua.VariantType.LocalizedText)
        await node.write_attribute(ua.AttributeIds.Description, ua.DataValue(description))
        await self._write(identifier, _data(entry.kind, None, None))

    async def _write(self, identifier: str, data: Any) -> None:
        await self._server.write_attribute_value(ua.NodeId(identifier, 1), data)


def _id_of(*parts: str) -> str:
    """Return a node's identifier; a name with a slash in it stays one part."""
    return "/".join(part.replace("%", "%25").replace("/", "%2F") for part in parts)


def _data(kind: str, value: Any, moment: float | None) -> Any:
    """Return a value with its status: bad for None, uncertain for a value in a list."""
    code = ua.StatusCodes.Good
    if isinstance(value, list):
        value, code = value[0], ua.StatusCodes.Uncertain
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return _bad(ua.StatusCodes.BadWaitingForInitialData)
    source = datetime.now(UTC) if moment is None else datetime.fromtimestamp(moment, UTC)
    return ua.DataValue(
        _variant(kind, value), StatusCode=ua.StatusCode(code), SourceTimestamp=source
    )


def _bad(code: int) -> Any:
    """Return what stands for a value that there is none of."""
    return ua.DataValue(StatusCode=ua.StatusCode(code), SourceTimestamp=datetime.now(UTC))


def _variant(kind: str, value: Any) -> Any:
    if kind == "DeviceHealth":
        return ua.Variant(int(value), ua.VariantType.Int32)
    if kind == "DateTime":
        value = datetime.fromtimestamp(value, UTC)
    elif kind == "LocalizedText":
        value = ua.LocalizedText(value)
    elif kind == "Double":
        value = float(value)
    return ua.Variant(value, ua.VariantType[kind])
