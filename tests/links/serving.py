"""A Modbus server beside a test, in a thread: a command has an event loop of its own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.listening import listen

__all__ = ["served_in_a_thread"]


@contextmanager
def served_in_a_thread(devices: Sequence[Any], place: Listening) -> Iterator[int]:
    """Serve while the block runs; gives the port."""
    ready, ports = threading.Event(), []
    loop = asyncio.new_event_loop()
    stop = asyncio.Event()

    async def serve() -> None:
        server, number = await listen(list(devices), place)
        ports.append(number)
        ready.set()
        await stop.wait()
        await server.shutdown()  # type: ignore[no-untyped-call]
        await asyncio.sleep(0)

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    try:
        assert ready.wait(60.0)
        yield ports[0]
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()
