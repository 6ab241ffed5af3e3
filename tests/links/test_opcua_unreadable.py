"""An OPC UA server whose answers cannot be read or cease, or whose connection breaks."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Client

from fieldlink.daemon import Daemon
from fieldlink.links import LinkState, open_link
from fieldlink.site import Site, load_site
from tests.daemon.live import unrehearsed_pools
from tests.links.opcua_server import OpcuaServer, scan_until
from tests.seeds import in_suite

TYPE_OF_ANSWER = 24
"""Where in a message the node id of its type begins: behind the headers of channel and sequence."""


class Between:
    """A proxy that spoils what the server says, or is silent, while it is told to."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._ways: list[asyncio.StreamWriter] = []
        self.port = 0
        self.spoils = self.mutes = False
        self.unheard: list[tuple[str, int]] = []
        """What clients did while it was silent, and which connection: they spoke, or left."""

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
            self._carry(reader, to_server, client=True),
            self._carry(from_server, writer, client=False),
        )

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, client: bool
    ) -> None:
        try:
            while data := await reader.read(65536):
                if self.mutes:
                    if client:
                        self.unheard.append(("spoke", id(reader)))
                    continue
                if not client and self.spoils and data.startswith(b"MSG"):
                    data = data[:TYPE_OF_ANSWER] + b"\x3d" + data[TYPE_OF_ANSWER + 1 :]
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            return
        finally:
            if client and self.mutes:
                self.unheard.append(("left", id(reader)))
            writer.close()


@pytest.mark.parametrize("error", [struct.error("unpack requires 4 bytes"), AssertionError()])
async def test_a_handshake_that_cannot_be_read_is_a_reason_of_the_device(
    make_opcua_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """What asyncua raised over bytes that were changed on their way, one in forty handshakes."""

    async def connect(_: Client) -> None:
        raise error

    monkeypatch.setattr(Client, "connect", connect)
    link: Any = open_link(make_opcua_site(4840, loops=1).with_device("plc", timeout=0.2), "plc")
    scan = await link.scan()
    await link.close()
    assert link.state is LinkState.DEMOTED
    assert "its answer cannot be read (" in str(scan.failures[0])


@pytest.fixture(autouse=True, scope="module")
def _unrehearsed() -> Iterator[None]:
    with unrehearsed_pools():
        yield


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def server() -> AsyncIterator[OpcuaServer]:
    running = OpcuaServer(few_nodes=True, loops=1)
    await running.start()
    yield running
    await running.kill()


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize("mode", in_suite(1, ["subscribe", "read"]))
async def test_spoilt_answers_and_lost_connections_are_reasons_of_the_device(
    server: OpcuaServer, make_opcua_site: Callable[..., Site], mode: str
) -> None:
    between = Between(server.port)
    async with between.serving():
        site = make_opcua_site(between.port, opcua=f'mode = "{mode}"', loops=1)
        link: Any = open_link(site.with_device("plc", timeout=0.5), "plc")
        await scan_until(link, lambda scan: scan["L0.OP"].good, "a good value")
        between.spoils = True
        spoilt = await scan_until(link, lambda scan: scan.failures, "a failure")
        assert not spoilt["L0.OP"].good
        assert link.state is LinkState.DEMOTED
        if mode == "read":  # no subscription hides it
            assert "an answer that cannot be read" in str(spoilt.failures[0])
        between.spoils = False
        await scan_until(link, lambda scan: scan["L0.OP"].good, "a good value")
        between.cut()
        lost = await scan_until(link, lambda scan: scan.failures, "a failure")
        said = str(lost.failures[0])
        assert "BadShutdown" not in said
        await scan_until(link, lambda scan: scan["L0.OP"].good, "a good value")
        assert link.connects == (3 if mode == "read" else 2)
        await link.close()


@pytest.mark.asyncio(loop_scope="module")
async def test_silent_servers_do_not_hold_up_the_end_one_after_the_other(
    server: OpcuaServer, tmp_path: Path
) -> None:
    between = Between(server.port)
    async with between.serving():
        (tmp_path / "nodes.csv").write_text("tag,node\nOP,ns=1;s=L0.OP\nPV,ns=1;s=L0.PV\n")
        parts = ['[site]\nname = "silent"\n']
        for n in range(4):
            parts.append(
                f'[devices.d{n}]\nlink = "opcua"\nhost = "127.0.0.1"\nport = {between.port}\n'
                f'register_map = "nodes.csv"\ntimeout = 4.0\n'
                f'[loops.L{n}]\ndevice = "d{n}"\nop = "OP"\npv = "PV"\nperiod = 6.0\n'
            )
        (tmp_path / "site.toml").write_text("\n".join(parts))
        stop = asyncio.Event()
        daemon = Daemon(load_site(tmp_path / "site.toml"))
        running = asyncio.create_task(daemon.run(stop=stop))
        until = time.monotonic() + 60.0
        while not all(device.connects for device in daemon.status().devices.values()):
            assert time.monotonic() < until, "no samples"
            await asyncio.sleep(0.1)
        between.mutes = True
        stop.set()
        await running
        # all had asked to be closed before the first one gave up
        done = [what for what, _ in between.unheard]
        spoke = {which for _, which in between.unheard[: done.index("left")]}
        assert len(spoke) == 4
        assert {which for what, which in between.unheard if what == "left"} == spoke
