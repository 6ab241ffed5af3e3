"""What ``fieldlink check`` knows about a site, as plain data.

Nothing here is read from a device: it is what the site file means, request by request.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fieldlink.registers import Apart, ReadRequest, Tag
from fieldlink.registers.types import order_name
from fieldlink.site.check_warnings import find_apart_tags, find_warnings
from fieldlink.site.checked_site import Site
from fieldlink.site.device import Device
from fieldlink.site.models import Loop

__all__ = ["CheckReport", "DeviceReport", "LoopReport", "RequestReport", "WriteBackReport", "check"]


@dataclass(frozen=True, slots=True)
class RequestReport:
    """One read request: Modbus function code, table, first and last address, the tags it brings.

    A Read request of OPC UA has function 0 and table "nodes"; its addresses count the nodes.

    ``every`` is the number of seconds between two of them; 0 means that every scan sends it, or
    every ``polls``-th one where its loops have longer periods than others of the device.
    """

    function: int
    table: str
    first: int
    last: int
    tags: tuple[str, ...]
    every: float = 0.0
    polls: int = 1


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """One device: how it is reached, and what one scan of it asks for."""

    name: str
    link: str
    address: str
    order: str
    tags: int
    requests: tuple[RequestReport, ...]


@dataclass(frozen=True, slots=True)
class WriteBackReport:
    """Where a loop's blocks go: the parts of the exchange area with first and last register."""

    enabled: bool
    loop_id: int
    areas: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True, slots=True)
class LoopReport:
    """One loop.

    Attributes:
        name, device: of the loop.
        tags: role to tag.
        op_pv_together: whether OP and PV come from one request; None without a register map.
        period, window_seconds, estimate_every: in plant seconds.
        writeback: None when the loop has no exchange area.
        plant: what a simulated PLC hosts, empty when nothing.
    """

    name: str
    device: str
    tags: dict[str, str]
    op_pv_together: bool | None
    period: float
    window_seconds: float
    estimate_every: float
    writeback: WriteBackReport | None
    plant: str


@dataclass(frozen=True, slots=True)
class CheckReport:
    """A site in figures, with warnings about what is allowed and yet unwise.

    ``upward`` says what is published where, ``opcua_server`` what is served to OPC UA clients; both
    are empty when nothing is.
    """

    name: str
    file: str
    data_dir: str
    historian: str
    devices: tuple[DeviceReport, ...]
    loops: tuple[LoopReport, ...]
    warnings: tuple[str, ...]
    upward: str = ""
    opcua_server: str = ""

    @property
    def requests_per_scan(self) -> int:
        """Read requests of one scan of all devices that read everything."""
        return sum(len(device.requests) for device in self.devices)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as dictionaries, lists, strings and numbers."""
        return asdict(self) | {"requests_per_scan": self.requests_per_scan}


def check(site: Site) -> CheckReport:
    """Return what the site means: devices, requests, loops, write-back areas, warnings."""
    requests = {name: site.requests(name) for name in site.devices}
    pairs: dict[str, list[tuple[str, ...]]] = {name: [] for name in site.maps}
    for loop in site.loops.values():
        if loop.device in pairs:
            pairs[loop.device].append((loop.op, loop.pv))
    apart = {
        name: find_apart_tags(site, name, requests[name], wanted) for name, wanted in pairs.items()
    }
    return CheckReport(
        name=site.name,
        file=str(site.path),
        data_dir=str(site.data_dir),
        historian=site.historian_shown,
        devices=tuple(
            _device(site, name, device, requests[name]) for name, device in site.devices.items()
        ),
        loops=tuple(_loop(name, loop, apart.get(loop.device)) for name, loop in site.loops.items()),
        warnings=tuple(find_warnings(site, requests)),
        upward=_upward(site),
        opcua_server=_opcua_server(site),
    )


def _upward(site: Site) -> str:
    mqtt = site.file.mqtt
    if mqtt is None:
        return ""
    secured = "with TLS" if mqtt.tls is not None else "not encrypted"
    commands = f"commands {', '.join(mqtt.commands)}" if mqtt.commands else "no commands"
    return (
        f"{', '.join(mqtt.publish)} as {' and '.join(mqtt.formats)} to {mqtt.host}:{mqtt.port} "
        f"({secured}); {commands}"
    )


def _opcua_server(site: Site) -> str:
    server = site.file.opcua_server
    if server is None:
        return ""
    secured = "encrypted" if server.cert is not None else "not encrypted"
    who = "anonymous clients" if server.username is None else f"user {server.username}"
    trusted = f", {len(server.trusted)} trusted certificates" if server.trusted else ""
    return f"read-only on {server.host}:{server.port} ({secured}); {who}{trusted}"


def _device(
    site: Site, name: str, device: Device, requests: tuple[ReadRequest, ...]
) -> DeviceReport:
    return DeviceReport(
        name=name,
        link=device.link,
        address=device.where,
        order="" if device.is_opcua else _orders(device, site.maps.get(name, {}).values()),
        tags=len(site.maps.get(name, {})),
        requests=tuple(
            RequestReport(
                function=0 if device.is_opcua else request.table.read_function,
                table="nodes" if device.is_opcua else request.table.value,
                first=request.address,
                last=request.end - 1,
                tags=tuple(tag.name for tag in request.tags),
                every=request.every,
                polls=request.polls,
            )
            for request in requests
        ),
    )


def _orders(device: Device, tags: Iterable[Tag]) -> str:
    """Return the orders in which values of several registers are read; a map may have its own."""
    several = {order_name(tag.word_order, tag.byte_order) for tag in tags if tag.count > 1}
    return " and ".join(sorted(several)) or order_name(device.word_order, device.byte_order)


def _loop(name: str, loop: Loop, apart: Mapping[tuple[str, ...], Apart] | None) -> LoopReport:
    """Return the report of a loop.

    Args:
        name: of the loop.
        loop: its settings.
        apart: groups of its device's tags that no request brings; None without a register map.
    """
    roles = ("op", "pv", "sp", "mode", "scan")
    layout, loop_id = loop.writeback.exchange, loop.writeback.loop_id
    writeback = None
    if layout is not None and loop_id is not None:
        writeback = WriteBackReport(loop.writeback.enabled, loop_id, layout.spans())
    plant = ""
    if loop.plant is not None:
        part = loop.plant.of and f"FMU of {loop.plant.of}"
        what = loop.plant.fmu or part or f"recording {loop.plant.recording}"
        plant = f"{what}, controller {loop.plant.controller_kind}"
    return LoopReport(
        name=name,
        device=loop.device,
        tags={role: getattr(loop, role) for role in roles if getattr(loop, role) is not None},
        op_pv_together=None if apart is None else (loop.op, loop.pv) not in apart,
        period=loop.period,
        window_seconds=loop.window * loop.period,
        estimate_every=loop.estimate_period,
        writeback=writeback,
        plant=plant,
    )
