"""The simulated PLC on a wire: virtual PLCs behind Modbus, paced by the monotonic clock.

    async with PlcServer({1: VirtualPlc(site, "plc", speed=20.0)}) as server:
        print(server.port)
        await server.run(stop)

`serve` does that for a whole site. Each PLC scans every ``scan_period / speed`` to deadlines
counted from the start, so that the plant's time does not drift from the wall clock. A scan that is
not done by the next one's deadline is late and counted; what is missed is caught up, but a pause of
more than a second (a suspended machine) is left out, as a PLC would. Paced by its reader, a scan
waits until a client has read the one before, and nothing is caught up: on a machine that has other
work the plant is slower, and no sample is lost.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import structlog
from pymodbus.server.base import ModbusBaseServer

from fieldlink.lab.plc.build import PlcError
from fieldlink.lab.plc.listening import LOOPBACK, Listening, listen
from fieldlink.lab.plc.modbus_device import modbus_device, other_units
from fieldlink.lab.plc.virtual import VirtualPlc
from fieldlink.links import Clock, SystemClock
from fieldlink.site import Device, Site

__all__ = ["PlcServer", "ServedUnit", "serve"]

PATIENCE = 0.1
"""Seconds that a scan waits for plants, once for each that hangs: a plant needs 0.0002 s."""

CATCH_UP = 1.0

READER_PATIENCE = 2.0
"""Seconds that a scan paced by its reader waits for a read, or for its plants: as long as the
slowest client of a demonstration waits for an answer. A client that stays away is waited for once,
until one reads again."""

_log = structlog.get_logger(__name__)


@dataclass(slots=True)
class ServedUnit:
    """One PLC behind a server, and how its scans keep up.

    Attributes:
        plc: the PLC.
        unit: the unit id it answers to.
        late: scans that were not done by the next one's deadline.
        left_out: seconds of the wall clock that were not caught up.
        has_reader: whether a client reads scan after scan, for one that is paced by it.
    """

    plc: VirtualPlc
    unit: int
    late: int = 0
    left_out: float = 0.0
    has_reader: bool = False


class PlcServer:
    """One Modbus endpoint with one virtual PLC a unit id.

    Args:
        units: unit id to PLC; the server closes them.
        host: address to bind.
        port: 0 picks a free one, see `port` after the start.
        clock: paces the scans.
        listening: the transport, instead of TCP on ``host`` and ``port``.
    """

    def __init__(
        self,
        units: Mapping[int, VirtualPlc],
        *,
        host: str = LOOPBACK,
        port: int = 0,
        clock: Clock | None = None,
        listening: Listening | None = None,
    ) -> None:
        self._place = listening or Listening(host=host, port=port)
        self.units = tuple(ServedUnit(plc, unit) for unit, plc in units.items())
        self.host = self._place.serial_port or self._place.host
        self.port = self._place.port
        self._clock: Clock = clock or SystemClock()
        self._server: ModbusBaseServer | None = None

    @property
    def where(self) -> str:
        """Where it listens, as people write it."""
        return replace(self._place, port=self.port).where

    async def start(self) -> None:
        """Run the first scan of every PLC, then listen: no client ever sees an empty image.

        Raises:
            PortError: the port is taken or the address is not this machine's.
        """
        for served in self.units:
            served.plc.scan()
        devices = [modbus_device(served.plc.image, served.unit) for served in self.units]
        if self._place.answers_for_others and all(served.unit for served in self.units):
            devices.append(other_units())
        self._server, self.port = await listen(devices, self._place)

    async def run(self, stop: asyncio.Event | None = None) -> None:
        """Scan until ``stop`` is set, or for ever; an error in a scan ends it."""
        pacers = [asyncio.create_task(self._pace(served)) for served in self.units]
        waiter = asyncio.create_task((stop or asyncio.Event()).wait())
        try:
            done, _ = await asyncio.wait({*pacers, waiter}, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                await task
        finally:
            for task in (*pacers, waiter):
                task.cancel()
            await asyncio.gather(*pacers, waiter, return_exceptions=True)

    async def close(self) -> None:
        """Stop listening and end the plants; may be called twice."""
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]
            self._server = None
        for served in self.units:
            served.plc.close()

    async def __aenter__(self) -> Self:
        try:
            await self.start()
        except BaseException:
            await self.close()
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def _pace(self, served: ServedUnit) -> None:
        plc = served.plc
        interval = plc.scan_period / plc.speed
        deadline = self._clock.monotonic() + interval
        known: set[str] = set()
        while True:
            # Also when it is late already: the network has a turn between two scans.
            await self._clock.sleep_until(deadline if plc.pace != "plant" else 0.0)
            if plc.pace == "reader":
                await self._await_reader(served, interval)
                waited = max(0.0, self._clock.monotonic() - deadline)
                served.left_out += waited
                deadline += waited
            plc.scan()
            for loop in plc.failures.keys() - known:
                known.add(loop)
                _log.error(
                    "loop stands still",
                    device=plc.device,
                    why=f"{plc.failures[loop]}; restart the PLC to go on",
                )
            if plc.pace == "plant":
                continue
            deadline += interval
            lag = self._clock.monotonic() - deadline
            if lag > 0.0:
                served.late += 1
            if lag > CATCH_UP:
                served.left_out += lag
                deadline += lag

    async def _await_reader(self, served: ServedUnit, interval: float) -> None:
        """Return when a client has read the last scan; at once where there is no client."""
        until = self._clock.monotonic() + READER_PATIENCE
        while served.has_reader and not served.plc.is_read and self._clock.monotonic() < until:
            await self._clock.sleep_until(self._clock.monotonic() + 0.1 * interval)
        served.has_reader = served.plc.is_read


async def serve(
    site: Site,
    *,
    port: int | None = None,
    speed: float | None = None,
    operator_switch: bool = False,
    ready: Callable[[Sequence[PlcServer]], None] | None = None,
    stop: asyncio.Event | None = None,
) -> tuple[PlcServer, ...]:
    """Serve every Modbus device of a site that has a loop with a plant, until ``stop``.

    Args:
        site: the site; a device's ``host`` (or ``plc_serial_port``) is where its server listens.
        port: instead of the site's (0 picks a free one); for a site with one endpoint.
        speed: instead of every device's own.
        operator_switch: whether clients may write ``enable``, as an operator's panel does.
        ready: called once all servers listen.
        stop: ends it.

    Returns:
        The servers, closed, for their counts and `VirtualPlc.truth`.

    Raises:
        PlcError: nothing to serve, or ``port`` is given and there are several endpoints.
        PortError: a port is not available.
    """
    servers: list[PlcServer] = []
    async with contextlib.AsyncExitStack() as stack:
        for place, names in _endpoints(site, port).items():
            units: dict[int, VirtualPlc] = {}
            for name in names:
                device = site.devices[name]
                plc = VirtualPlc(
                    site,
                    name,
                    speed=speed or device.speed,
                    pace=device.pace,
                    patience=PATIENCE if device.pace != "reader" else READER_PATIENCE,
                    operator_switch=operator_switch,
                )
                stack.callback(plc.close)
                units[device.unit] = plc
            here = place if port is None else replace(place, port=port)
            server = PlcServer(units, listening=here)
            servers.append(await stack.enter_async_context(server))
        if ready is not None:
            ready(tuple(servers))
        runs = [asyncio.create_task(server.run(stop)) for server in servers]
        try:
            await asyncio.gather(*runs)
        finally:
            for run in runs:
                run.cancel()
            await asyncio.gather(*runs, return_exceptions=True)
    return tuple(servers)


def _endpoints(site: Site, port: int | None) -> dict[Listening, list[str]]:
    """Return the devices to serve by where they are served."""
    endpoints: dict[Listening, list[str]] = {}
    for name, device in site.devices.items():
        hosted = any(loop.plant is not None for loop in site.loops_of(name).values())
        if device.is_modbus and hosted:
            endpoints.setdefault(_place(site, name, device), []).append(name)
    if not endpoints:
        raise PlcError(
            f"site {site.name}: no Modbus device has a loop with a plant; "
            "add a table [loops.NAME.plant] with an fmu or a recording"
        )
    if port is not None and len(endpoints) > 1:
        listed = ", ".join(place.where for place in endpoints)
        raise PlcError(
            f"--port needs a site with one endpoint, {site.name} has {len(endpoints)} ({listed}); "
            "change the ports in the site file"
        )
    return endpoints


def _place(site: Site, name: str, device: Device) -> Listening:
    if device.link == "modbus-rtu":
        if device.plc_serial_port is None:
            raise PlcError(
                f"device {name}: the simulated PLC has to be at the other end of "
                f"{device.serial_port}; give its serial port as plc_serial_port"
            )
        return Listening(
            link=device.link,
            serial_port=device.plc_serial_port,
            baud=device.baud,
            parity=device.parity[0].upper(),
            data_bits=device.data_bits,
            stop_bits=device.stop_bits,
        )
    tls = device.tls
    cert, key, ca = (None, None, None) if tls is None else (tls.plc_cert, tls.plc_key, tls.ca)
    return Listening(
        link=device.link,
        host=device.host or LOOPBACK,
        port=device.port,
        cert=None if cert is None else site.resolve(cert),
        key=None if key is None else site.resolve(key),
        ca=None if ca is None else site.resolve(ca),
    )
