"""Other Modbus stacks as processes, and serial lines between them and us."""

from __future__ import annotations

import asyncio
import shutil
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.serial_lines import serial_line as joined_ends

NODE = Path(__file__).resolve().parent / "node"
ROOT = Path(__file__).resolve().parents[2]


@asynccontextmanager
async def running(*command: str) -> AsyncIterator[str]:
    """Run a server and give the first line it prints."""
    process = await asyncio.create_subprocess_exec(
        *command, cwd=ROOT, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        line = (await asyncio.wait_for(process.stdout.readline(), 30.0)).decode().strip()
        assert line, (await process.stderr.read()).decode()
        yield line
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


@pytest.fixture
def libmodbus() -> tuple[str, ...]:
    """The command of the libmodbus server."""
    from benchmarks.libmodbus import LibModbusMissingError, library

    try:
        library()
    except LibModbusMissingError as missing:
        pytest.skip(str(missing))
    return (sys.executable, "-m", "benchmarks.libmodbus")


@pytest.fixture
def node() -> tuple[str, ...]:
    """The command that runs a script with modbus-serial at hand."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not installed (Debian package nodejs)")
    if not (NODE / "node_modules" / "modbus-serial").is_dir():
        pytest.skip("modbus-serial is not installed (npm install --prefix tests/interop/node)")
    return (program,)


@pytest.fixture
async def serial_line(tmp_path: Path) -> AsyncIterator[tuple[str, str]]:
    async with joined_ends(tmp_path) as ends:
        yield ends


@pytest.fixture
def start() -> Callable[..., Any]:
    """Run a server and give the first line it prints, in an ``async with``."""
    return running
