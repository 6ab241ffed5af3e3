"""Strangers at the endpoints: connections that say nothing, half a request, or nonsense."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from fieldlink.daemon import Daemon
from fieldlink.site import load_site
from fieldlink.web import web_server
from fieldlink.web.limits import MOST_CONNECTIONS, QuietLog, TimedProtocol


@pytest.fixture
async def port(tmp_path: Path, live: Any) -> AsyncIterator[int]:
    site = live.site_for(tmp_path, {"plc": 9})
    site.path.write_text(site.path.read_text() + "\n[web]\nport = 0\n")
    site = load_site(site.path)
    async with web_server(site, Daemon(site)) as found:
        assert found is not None
        yield found


async def send(port: int, data: bytes) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(data)
    await writer.drain()
    return reader, writer


async def end(reader: asyncio.StreamReader) -> bytes:
    with contextlib.suppress(ConnectionError):
        async with asyncio.timeout(60.0):
            return await reader.read()
    return b""


@pytest.mark.parametrize(
    "half", [b"", b"GET /healthz HTTP/1.1\r\nHost: x\r\n", b"POST /a HTTP/1.1"]
)
async def test_half_sent_requests_keep_nobody_out(port: int, half: bytes) -> None:
    clients = [await send(port, half) for _ in range(3 * MOST_CONNECTIONS)]
    async with httpx.AsyncClient(timeout=60.0) as client:
        for _ in range(3):
            assert (await client.get(f"http://127.0.0.1:{port}/healthz")).status_code == 200
    # The oldest had to go: their ends come without any time-out.
    for reader, _ in clients[:MOST_CONNECTIONS]:
        assert await end(reader) == b""
    for _, writer in clients:
        writer.close()


async def test_a_request_that_is_not_finished_in_time_is_ended(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TimedProtocol, "seconds", 0.05)
    reader, writer = await send(port, b"GET /healthz HTTP/1.1\r\n")
    assert await end(reader) == b""
    writer.close()


async def test_what_strangers_send_is_a_line_a_minute(
    port: int, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        for _ in range(50):
            reader, writer = await send(port, b"\x16\x03\x01 this is no HTTP\r\n\r\n")
            assert (await end(reader)).startswith(b"HTTP/1.1 400")
            writer.close()
    assert [record.getMessage() for record in caplog.records] == ["Invalid HTTP request received."]


def test_held_back_lines_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("fieldlink.once_a_minute.time.monotonic", lambda: now)
    quiet, told = QuietLog(), []
    for now in (0.0, 1.0, 59.0, 60.0, 61.0):  # noqa: B007
        record = logging.LogRecord("x", logging.WARNING, "", 0, "from %s", ("a stranger",), None)
        if quiet.filter(record):
            told.append(record.getMessage())
    assert told == ["from a stranger", "from a stranger (2 more of these since the last line)"]
