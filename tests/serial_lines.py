"""Serial lines without a cable: pseudo-terminals that socat joins to each other or to a socket."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

__all__ = ["line_to_port", "serial_line"]


@asynccontextmanager
async def serial_line(folder: Path) -> AsyncIterator[tuple[str, str]]:
    """Give both ends of a line."""
    ends = folder / "there", folder / "here"
    async with _socat(ends, *(f"pty,raw,echo=0,link={end}" for end in ends)):
        yield str(ends[0]), str(ends[1])


@asynccontextmanager
async def line_to_port(port: int, folder: Path) -> AsyncIterator[str]:
    """Give a serial port whose other end is a TCP port."""
    here = folder / "tty"
    async with _socat((here,), f"pty,raw,echo=0,link={here}", f"tcp:127.0.0.1:{port}"):
        yield str(here)


@asynccontextmanager
async def _socat(ends: tuple[Path, ...], *addresses: str) -> AsyncIterator[None]:
    program = shutil.which("socat")
    if program is None:
        pytest.skip("socat is not installed (Debian package socat)")
    process = await asyncio.create_subprocess_exec(program, *addresses)
    try:
        async with asyncio.timeout(60.0):
            while not all(end.exists() for end in ends):
                await asyncio.sleep(0.01)
        yield
    finally:
        process.terminate()
        await process.wait()
