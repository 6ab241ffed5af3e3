"""The Modbus TCP link: a device's tags by a precomputed read plan, and guarded writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient

from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.links.base import LinkState, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.connection import ModbusConnection
from fieldlink.links.errors import AccessRefusedError
from fieldlink.links.plan_reader import PlanReader
from fieldlink.registers import ReadRequest, Table
from fieldlink.site import Site

__all__ = ["ModbusTcpLink", "ModbusTcpSettings"]

WRITE_LIMIT = 123
"""The most registers one FC16 request may write (Modbus application protocol 1.1b3)."""

WRITTEN_PARTS = frozenset({"heartbeat", "commit", "bank_a", "bank_b"})
"""The parts of an exchange area that are Fieldlink's to write; the others are the PLC's."""


@dataclass(frozen=True, slots=True)
class ModbusTcpSettings:
    """Where a device is and how patient to be with it.

    Attributes:
        device: its name in the site file.
        host, port, unit: its address.
        timeout: seconds for connecting and for every reply.
        backoff: pauses after failures.
        quarantine: seconds until a register that answered with an exception is tried again.
        writable: holding registers (first, last) that may be written; nothing by default.
    """

    device: str
    host: str
    port: int = 502
    unit: int = 1
    timeout: float = 0.5
    backoff: BackoffSettings = field(default_factory=BackoffSettings)
    quarantine: float = 60.0
    writable: tuple[tuple[int, int], ...] = ()


class ModbusTcpLink:
    """A `Link` with `RegisterAccess` over one TCP connection.

    Args:
        settings: the device.
        plan: its read plan.
        clock: stamps the readings and times the pauses.
    """

    def __init__(
        self, settings: ModbusTcpSettings, plan: Sequence[ReadRequest], clock: Clock
    ) -> None:
        self._settings = settings
        self._connection = ModbusConnection(
            settings.device,
            f"{settings.host}:{settings.port} unit {settings.unit}",
            settings.unit,
            self._make_client,
            Backoff(settings.backoff),
            clock,
        )
        self._reader = PlanReader(plan, self._connection.read, clock, settings.quarantine)

    @classmethod
    def of_site(cls, site: Site, device: str, clock: Clock) -> ModbusTcpLink:
        """Build the link of a device of the site file.

        Writable are the registers that Fieldlink has in the exchange areas of loops whose
        write-back is enabled, and nothing else.
        """
        settings = site.devices[device]
        layouts = [
            loop.writeback.exchange
            for loop in site.loops_of(device).values()
            if loop.writeback.enabled
        ]
        return cls(
            ModbusTcpSettings(
                device=device,
                host=settings.host or "",
                port=settings.port,
                unit=settings.unit,
                timeout=settings.timeout,
                writable=tuple(
                    (first, last)
                    for layout in layouts
                    if layout is not None
                    for part, first, last in layout.spans()
                    if part in WRITTEN_PARTS
                ),
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
        """Requests sent since the link was made, reads and writes."""
        return self._connection.requests

    async def open(self) -> None:
        """Nothing to prepare: the first request connects, and an absent device is tried again."""

    async def scan(self) -> Scan:
        """Read every tag of the plan once."""
        return await self._reader.scan()

    async def close(self) -> None:
        """Close the connection."""
        await self._connection.close()

    async def read_registers(self, address: int, count: int) -> list[int]:
        """Read holding registers in one request (FC3)."""
        return await self._connection.read(Table.HOLDING, address, count)

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        """Write registers in one request (FC16).

        Raises:
            AccessRefusedError: a register is outside the writable ranges, or there are too many.
            LinkError: the device did not confirm; after a `LinkTimeoutError` the write
                may have been carried out.
        """
        self._guard(address, len(words))
        await self._connection.write_many(address, words)

    async def write_register(self, address: int, word: int) -> None:
        """Write one register (FC6); errors as `write_registers`."""
        self._guard(address, 1)
        await self._connection.write_one(address, word)

    def _guard(self, address: int, count: int) -> None:
        last = address + count - 1
        if not 1 <= count <= WRITE_LIMIT:
            raise AccessRefusedError(
                self._settings.device,
                f"writing {count} registers in one request",
                f"write between 1 and {WRITE_LIMIT}",
            )
        if not any(first <= address and last <= end for first, end in self._settings.writable):
            allowed = ", ".join(f"{first} to {end}" for first, end in self._settings.writable)
            raise AccessRefusedError(
                self._settings.device,
                f"writing holding {address} to {last} is not allowed by the site file",
                f"allowed: {allowed or 'nothing (write-back is off)'}",
            )

    def _make_client(self, on_connection: Callable[[bool], None]) -> ModbusBaseClient:
        return AsyncModbusTcpClient(
            self._settings.host,
            port=self._settings.port,
            name=self._settings.device,
            timeout=self._settings.timeout,
            retries=0,
            reconnect_delay=0,
            reconnect_delay_max=0,
            trace_connect=on_connection,
        )
