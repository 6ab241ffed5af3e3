"""The Modbus link: a device's tags by a precomputed read plan, and guarded writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.links.base import LinkState, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.connection import ModbusConnection
from fieldlink.links.errors import AccessRefusedError
from fieldlink.links.plan_reader import PlanReader
from fieldlink.links.transports import line_settings
from fieldlink.links.writable import Ranges, find_writable
from fieldlink.registers import ReadRequest, Table, unpack_payload
from fieldlink.site import Device, Site

__all__ = ["ModbusLink", "ModbusSettings"]

WRITE_LIMIT = 123
"""The most registers one FC16 request may write (Modbus application protocol 1.1b3)."""

COIL_WRITE_LIMIT = 1968
"""The most coils one FC15 request may write (same source)."""


@dataclass(frozen=True, slots=True)
class ModbusSettings:
    """How a device is treated.

    Attributes:
        name: its name in the site file.
        device: how it is reached, and its quirks.
        site: the site that the device's certificates belong to; None without one.
        backoff: pauses after failures; from the device unless given.
        quarantine: longest seconds until a register that answered with an exception is tried again.
        writable: holding registers (first, last) that may be written; nothing by default.
        writable_coils: coils (first, last) that may be written; nothing by default.
        beat: seconds between two scans, which time slower requests; 0 sends all in every scan.
    """

    name: str
    device: Device
    site: Site | None = None
    backoff: BackoffSettings | None = None
    quarantine: float = 60.0
    writable: Ranges = ()
    writable_coils: Ranges = field(default=())
    beat: float = 0.0


class ModbusLink:
    """A `Link` with `RegisterAccess` to one unit, on any transport.

    Args:
        settings: the device.
        plan: its read plan.
        clock: stamps the readings and times the pauses.
    """

    def __init__(self, settings: ModbusSettings, plan: Sequence[ReadRequest], clock: Clock) -> None:
        self._settings = settings
        device = settings.device
        first = min(0.1, device.retry_after_max)
        backoff = settings.backoff or BackoffSettings(first=first, cap=device.retry_after_max)
        resolve = Path if settings.site is None else settings.site.resolve
        self._connection = ModbusConnection(
            settings.name,
            device.where,
            device.unit,
            line_settings(device, settings.name, resolve),
            device.timeout,
            Backoff(backoff),
            clock,
            probes=device.quirks.probe_after_timeout,
        )
        self._reader = PlanReader(
            plan, self._connection.read, clock, settings.quarantine, settings.beat
        )

    @classmethod
    def of_site(cls, site: Site, device: str, clock: Clock) -> ModbusLink:
        """Build the link of a device of the site file.

        Writable are the registers that Fieldlink has in the exchange areas of loops whose
        write-back is enabled, and nothing else.
        """
        return cls(
            ModbusSettings(
                name=device,
                device=site.devices[device],
                site=site,
                writable=find_writable(site, device),
                beat=site.poll_period(device) / site.devices[device].speed,
            ),
            site.requests(device),
            clock,
        )

    @property
    def state(self) -> LinkState:
        """How the device answers."""
        return self._reader.state

    @property
    def requests(self) -> int:
        """Requests sent since the link was made: reads, writes, and probes after time-outs."""
        return self._connection.requests

    @property
    def connects(self) -> int:
        """How often the device's line was opened."""
        return self._connection.connects

    @property
    def late_replies(self) -> int:
        """Replies that came after their time-out and were recognised and passed over."""
        return self._connection.late_replies

    @property
    def quarantined(self) -> tuple[str, ...]:
        """The tags that are left out for now because their registers answer with an exception."""
        return self._reader.quarantined

    async def open(self) -> None:
        """Nothing to prepare: the first request connects, and an absent device is tried again."""

    async def scan(self) -> Scan:
        """Read every tag of the plan that is due once."""
        scan = await self._reader.scan()
        if self._settings.device.quirks.close_after_scan:
            await self._connection.hang_up()
        return scan

    async def close(self) -> None:
        """Close the connection."""
        await self._connection.close()

    async def read(self, table: Table, address: int, count: int) -> list[int]:
        """Read registers, or bits as 0 and 1, of any table in one request."""
        return unpack_payload(table, await self._connection.read(table, address, count), count)

    async def read_registers(self, address: int, count: int) -> list[int]:
        """Read holding registers in one request (FC3)."""
        return await self.read(Table.HOLDING, address, count)

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        """Write registers in one request (FC16).

        Raises:
            AccessRefusedError: a register is outside the writable ranges, or there are too many.
            LinkError: the device did not confirm; after a `LinkTimeoutError` the write
                may have been carried out.
        """
        self._guard(Table.HOLDING, address, len(words))
        await self._connection.write_many(address, words)

    async def write_register(self, address: int, word: int) -> None:
        """Write one register (FC6); errors as `write_registers`."""
        self._guard(Table.HOLDING, address, 1)
        await self._connection.write_one(address, word)

    async def write_coils(self, address: int, bits: Sequence[int]) -> None:
        """Write coils in one request (FC5 for one, FC15 for more); errors as `write_registers`."""
        self._guard(Table.COIL, address, len(bits))
        await self._connection.write_coils(address, bits)

    def _guard(self, table: Table, address: int, count: int) -> None:
        coils = table is Table.COIL
        limit = COIL_WRITE_LIMIT if coils else WRITE_LIMIT
        ranges = self._settings.writable_coils if coils else self._settings.writable
        last = address + count - 1
        if not 1 <= count <= limit:
            raise AccessRefusedError(
                self._settings.name,
                f"writing {count} {'coils' if coils else 'registers'} in one request",
                f"write between 1 and {limit}",
            )
        if not any(first <= address and last <= end for first, end in ranges):
            allowed = ", ".join(f"{first} to {end}" for first, end in ranges)
            raise AccessRefusedError(
                self._settings.name,
                f"writing {table} {address} to {last} is not allowed by the site file",
                f"allowed: {allowed or 'nothing (write-back is off)'}",
            )
