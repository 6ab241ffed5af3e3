"""Time-outs in tests: long where a device answers, short only where it will not.

A busy machine, or one that stands still for seconds, must not look like a silent device.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from fieldlink.links.modbus import ModbusLink

__all__ = ["PATIENCE", "SHORT", "expecting_silence", "until"]

PATIENCE = 60.0
"""Seconds: the time-out of a device that answers."""

SHORT = 0.05
"""Seconds: the time-out while a device will not answer, however long it is waited for."""


@contextmanager
def expecting_silence(link: ModbusLink) -> Iterator[None]:
    """The device does not answer inside this block; connections are still waited for."""
    connection = link._connection
    before, connection._timeout = connection._timeout, SHORT
    try:
        yield
    finally:
        connection._timeout = before


async def until(condition: Callable[[], bool]) -> None:
    """Wait for what a test has caused; the test's own time-out ends it."""
    while not condition():
        await asyncio.sleep(0)
