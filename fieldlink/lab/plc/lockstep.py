"""The link of kind "fmu": the simulated PLC in the same process, moved by its scans.

One `scan` runs one control cycle and reads the tags through the register image, so that rounding,
word order, ranges and refusals are those of the wire. There is no clock in it: a run is as fast as
the machine and the same for the same seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from compensator import LoopMemory
from fieldlink.lab.plc.image import RequestRefusedError
from fieldlink.lab.plc.virtual import BuildProgram, VirtualPlc, scan_period
from fieldlink.links.base import LinkState, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.errors import ExceptionReplyError, LinkUnreachableError, PlantFailedError
from fieldlink.links.plan_reader import PlanReader
from fieldlink.registers import Table, pack_payload
from fieldlink.site import Site

__all__ = ["LockstepLink"]


class LockstepLink:
    """A `SteppedLink` with `RegisterAccess` over a `VirtualPlc`.

    Args:
        site: the site.
        device: the device's name; its loops need a plant.
        clock: stamps the readings; the caller moves it by ``scan_period`` (plant seconds) a scan.
        programs: see `VirtualPlc`.
    """

    def __init__(
        self, site: Site, device: str, clock: Clock, *, programs: BuildProgram | None = None
    ) -> None:
        self._site = site
        self._device = device
        self._programs = programs
        self._plc: VirtualPlc | None = None
        self._told: set[str] = set()
        self._retained: dict[str, LoopMemory] = {}
        self.scan_period = float(scan_period(site, device))
        self._reader = PlanReader(site.requests(device), self._payload, clock)
        self.requests = 0

    @property
    def plc(self) -> VirtualPlc:
        """The PLC behind the link, while it is open.

        Raises:
            LinkUnreachableError: the link is not open.
        """
        if self._plc is None:
            raise LinkUnreachableError(self._device, "the link is not open", "call open() first")
        return self._plc

    @property
    def state(self) -> LinkState:
        """How the device answers."""
        return LinkState.CLOSED if self._plc is None else self._reader.state

    async def open(self) -> None:
        """Start the plants."""
        if self._plc is None:
            self._told.clear()
            self._plc = VirtualPlc(
                self._site, self._device, programs=self._programs, retained=self._retained
            )

    async def scan(self) -> Scan:
        """Run one control cycle, then read every mapped tag; a plant that failed is told once."""
        self.plc.scan()
        scan = await self._reader.scan()
        stopped = {loop: why for loop, why in self.plc.failures.items() if loop not in self._told}
        self._told.update(stopped)
        failures = tuple(
            PlantFailedError(self._device, why, "its loop stands still, the others go on")
            for why in stopped.values()
        )
        return replace(scan, failures=(*scan.failures, *failures))

    def go_on(self, seconds: float) -> None:
        """Let the PLC's block readers look ``seconds`` after the last scan."""
        if self._plc is not None:
            self._plc.watch(seconds)

    async def close(self) -> None:
        """Stop the plants; what the PLC retains is there when the link is opened again."""
        if self._plc is not None:
            self._retained = self._plc.retained
            self._plc.close()
            self._plc = None

    async def read_registers(self, address: int, count: int) -> list[int]:
        """Read holding registers."""
        return await self._read(Table.HOLDING, address, count)

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers, all or none."""
        self._write(address, words)

    async def write_register(self, address: int, word: int) -> None:
        """Write one holding register."""
        self._write(address, [word])

    async def _payload(self, table: Table, address: int, count: int) -> bytes:
        return pack_payload(table, await self._read(table, address, count))

    async def _read(self, table: Table, address: int, count: int) -> list[int]:
        self.requests += 1
        try:
            return self.plc.image.read(table, address, count)
        except RequestRefusedError as refused:
            raise ExceptionReplyError(self._device, str(refused), refused.code) from refused

    def _write(self, address: int, words: Sequence[int]) -> None:
        self.requests += 1
        try:
            self.plc.image.write(Table.HOLDING, address, words)
        except RequestRefusedError as refused:
            raise ExceptionReplyError(self._device, str(refused), refused.code) from refused
