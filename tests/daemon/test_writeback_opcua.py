"""Blocks go into an array of an OPC UA server by the rules and the protocol of registers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.writer import BlockWriter
from fieldlink.links import LinkError, open_link
from fieldlink.registers import BLOCK_REGISTERS, Bank, BlockReader, decode_block
from tests.daemon.bench import WINDOW_END, stored
from tests.links.opcua_server import OpcuaServer, write_site

BACK = "[loops.L0.writeback]\nenabled = true\nloop_id = 101\nbase = 10\nmin_windows = 1\n"


class Bench:
    """A write-back on a real session, and the PLC's program on the server's array."""

    def __init__(self, server: OpcuaServer, folder: Path) -> None:
        self.server = server
        node = 'exchange_node = "ns=1;s=Exchange"'
        site = write_site(folder, server.port, opcua=node, loop=BACK, loops=1)
        settings = site.loops["L0"].writeback
        assert settings.exchange is not None
        self.layout = settings.exchange
        self.link: Any = open_link(site, "plc")
        self.reader = BlockReader(101)
        self.said: list[Attempt] = []
        self.errors: list[LinkError] = []
        self.now = 0.0
        self.writer = BlockWriter(
            settings,
            Exchange(self.link, self.layout, "big", device="plc"),
            period=1.0,
            read_only=False,
            pause=self.scan,
            report=self.said.append,
            keep=stored,
            tell=lambda *_: None,
            numbers=SequenceNumbers(0),
        )

    @property
    def outcomes(self) -> list[WritebackOutcome]:
        return [attempt.outcome for attempt in self.said]

    async def enable(self) -> None:
        await self.server.tell(words=[[self.layout.enable, 1]])

    async def scan(self) -> None:
        words = await self.server.tell()
        view = self.layout.view(lambda address, count: words[address : address + count])
        state = self.reader.scan(view, self.now)
        await self.server.tell(words=list(state.reply(self.layout, None).items()))

    async def seconds(self, seconds: int, *, scanning: bool = True) -> None:
        for _ in range(seconds):
            try:
                await self.writer.service(self.now)
            except LinkError as error:
                self.errors.append(error)
            if scanning:
                await self.scan()
            self.now += 1.0

    async def until_accepted(self) -> None:
        before = len(self.said)
        for _ in range(200):
            if WritebackOutcome.ACCEPTED in self.outcomes[before:]:
                return
            await self.seconds(1)
        said = [(attempt.outcome.code, attempt.reason) for attempt in self.said[before:]]
        pytest.fail(f"never accepted: {said}, {self.errors}")

    async def block(self) -> Any:
        words = await self.server.tell()
        first = self.layout.bank_address(Bank(words[self.layout.active_bank]))
        return decode_block(words[first : first + BLOCK_REGISTERS], "big")


async def test_a_block_is_written_acknowledged_and_written_again_after_a_restart(
    tmp_path: Path, findings: Callable[..., Findings]
) -> None:
    server = OpcuaServer(few_nodes=True, loops=1, array=300)
    await server.start()
    bench = Bench(server, tmp_path)
    try:
        bench.writer.submit(findings(), WINDOW_END, since=0.0)
        await bench.seconds(3)
        assert set(bench.outcomes) == {WritebackOutcome.NOT_ENABLED}
        words = await server.tell()
        assert not any(words[bench.layout.bank_a : bench.layout.bank_a + BLOCK_REGISTERS])

        await bench.enable()
        await bench.until_accepted()
        block = await bench.block()
        assert (block.stick_band.value, block.slip_jump.value, block.seq) == (7.0, 4.0, 1)

        # the server loses everything; nothing is written until its operator allows it again
        await server.kill()
        await bench.seconds(5, scanning=False)
        assert bench.errors
        await server.start()
        bench.reader = BlockReader(101)
        before = len(bench.said)
        bench.writer.submit(findings(7.5), WINDOW_END, since=bench.now + 100.0)
        bench.now += 100.0
        await bench.seconds(3)
        assert WritebackOutcome.COMMITTED not in bench.outcomes[before:]
        await bench.enable()
        await bench.until_accepted()
        block = await bench.block()
        assert (block.stick_band.value, block.seq) == (7.5, 2)
    finally:
        await bench.link.close()
        await server.kill()
