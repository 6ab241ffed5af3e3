"""An OPC UA server whose answers cannot be taken apart, or whose connection breaks."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from fieldlink.links import LinkState, open_link
from fieldlink.site import Site
from tests.links.opcua_server import OpcuaServer

TYPE_OF_ANSWER = 24
"""Where in a message the node id of its type begins: behind the headers of channel and sequence."""


class Between:
    """A proxy that spoils what the server says, while it is told to."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._ways: list[asyncio.StreamWriter] = []
        self.port = 0
        self.spoils = False

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[None]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        try:
            yield
        finally:
            server.close()
            self.cut()

    def cut(self) -> None:
        """Break every connection."""
        for writer in self._ways:
            writer.close()
        self._ways.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        from_server, to_server = await asyncio.open_connection("127.0.0.1", self._port)
        self._ways += [writer, to_server]
        await asyncio.gather(
            self._carry(reader, to_server, spoil=False),
            self._carry(from_server, writer, spoil=True),
        )

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, spoil: bool
    ) -> None:
        try:
            while data := await reader.read(65536):
                if spoil and self.spoils and data.startswith(b"MSG"):
                    data = data[:TYPE_OF_ANSWER] + b"\x3d" + data[TYPE_OF_ANSWER + 1 :]
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            return
        finally:
            writer.close()


async def scan_until(link: Any, condition: Callable[[Any], bool]) -> Any:
    for _ in range(400):
        scan = await link.scan()
        if condition(scan):
            return scan
        await asyncio.sleep(0.02)
    pytest.fail(f"never happened; {scan.failures}")


@pytest.mark.parametrize("mode", ["read", "subscribe"])
async def test_spoilt_answers_and_lost_connections_are_reasons_of_the_device(
    make_opcua_site: Callable[..., Site], mode: str
) -> None:
    server = OpcuaServer(loops=1)
    await server.start()
    between = Between(server.port)
    try:
        async with between.serving():
            site = make_opcua_site(between.port, opcua=f'mode = "{mode}"', loops=1)
            link: Any = open_link(site.with_device("plc", timeout=0.5), "plc")
            await scan_until(link, lambda scan: scan["L0.OP"].good)
            between.spoils = True
            spoilt = await scan_until(link, lambda scan: scan.failures)
            assert not spoilt["L0.OP"].good
            assert link.state is LinkState.DEMOTED
            if mode == "read":  # no subscription hides it
                assert "an answer that cannot be read" in str(spoilt.failures[0])
            between.spoils = False
            await scan_until(link, lambda scan: scan["L0.OP"].good)
            between.cut()
            lost = await scan_until(link, lambda scan: scan.failures)
            said = str(lost.failures[0])
            assert "BadShutdown" not in said
            await scan_until(link, lambda scan: scan["L0.OP"].good)
            assert link.connects == (3 if mode == "read" else 2)
            await link.close()
    finally:
        await server.kill()
