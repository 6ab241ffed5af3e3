"""A write-back on a bench: a real link and socket, a PLC's program, time in the tester's hands."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Future
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.daemon.writeback.writer import BlockWriter
from fieldlink.links import LinkError, SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.writable import WRITTEN_PARTS
from fieldlink.registers import ExchangeLayout, Order
from fieldlink.site import Device
from fieldlink.site import WriteBack as Settings

WINDOW_END = 1_795_262_400.0


@dataclass
class Bench:
    """A write-back, its PLC, and the plant's time in the tester's hands."""

    writeback: BlockWriter
    plc: Any
    said: list[Attempt]
    told: list[tuple[str, str]]
    numbers: SequenceNumbers
    now: float = 0.0
    errors: list[LinkError] = field(default_factory=list)

    @property
    def outcomes(self) -> list[WritebackOutcome]:
        return [attempt.outcome for attempt in self.said]

    def submit(self, findings: Findings, *, compensated: bool = False) -> None:
        self.writeback.submit(findings, WINDOW_END, since=self.now, compensated=compensated)

    async def seconds(self, seconds: float, scanning: bool = True) -> None:
        """Let plant time pass: every second the write-back is called and the PLC scans."""
        for _ in range(round(seconds)):
            try:
                await self.writeback.service(self.now)
            except LinkError as error:
                self.errors.append(error)
            if scanning:
                self.plc.scan()
            self.now += 1.0

    async def write(self, findings: Findings) -> None:
        """Have findings written and acknowledged, with time enough for the minimum interval."""
        self.submit(findings)
        await self.seconds(5)
        assert self.outcomes[-2:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
        await self.seconds(70)


def stored(_: Attempt) -> Future[bool]:
    receipt: Future[bool] = Future()
    receipt.set_result(True)
    return receipt


@asynccontextmanager
async def benches(
    device: Any, plc: Any, layout: ExchangeLayout
) -> AsyncIterator[Callable[..., Bench]]:
    """Give what makes benches on one device; keywords: those of `BlockWriter`, its settings."""
    links = []

    def make(
        *,
        read_only: bool = False,
        pause: Callable[[], Awaitable[None]] | None = None,
        word_order: Order = "big",
        keep: Callable[[Attempt], Future[bool]] | None = None,
        identity: int | None = None,
        last_seq: int = 0,
        orders: StandingOrders | None = None,
        **settings: Any,
    ) -> Bench:
        link = ModbusLink(
            ModbusSettings(
                "plc",
                Device(
                    link="modbus-tcp",
                    host="127.0.0.1",
                    port=device.port,
                    timeout=1.0,
                    register_map=Path("map.csv"),
                ),
                backoff=BackoffSettings(first=1e-6, cap=1e-6),
                writable=tuple((a, b) for part, a, b in layout.spans() if part in WRITTEN_PARTS),
            ),
            (),
            SystemClock(),
        )
        links.append(link)
        said: list[Attempt] = []
        told: list[tuple[str, str]] = []
        numbers = SequenceNumbers(last_seq)

        async def nothing() -> None:
            plc.scan()

        writeback = BlockWriter(
            Settings(enabled=True, loop_id=101, base=100, **({"min_windows": 1} | settings)),
            Exchange(link, layout, word_order, device="plc"),
            period=1.0,
            read_only=read_only,
            pause=pause or nothing,
            report=said.append,
            keep=keep or stored,
            tell=lambda kind, message: told.append((kind, message)),
            numbers=numbers,
            identity=identity,
            orders=orders,
        )
        return Bench(writeback, plc, said, told, numbers)

    try:
        yield make
    finally:
        for link in links:
            await link.close()
