"""The spool's thread: the disk is never waited for in the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from fieldlink.upward.spool import Spool

__all__ = ["SpoolThread"]

T = TypeVar("T")


class SpoolThread:
    """Runs the spool's methods, one after the other.

    Args:
        spool: the spool.
    """

    def __init__(self, spool: Spool) -> None:
        self._spool = spool
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="mqtt-spool")

    async def call(self, work: Callable[[Spool], T]) -> T:
        """Return what ``work`` gives for the spool; raises what it raises."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, self._spool)

    @property
    def last_id(self) -> int:
        """Number of the newest message."""
        return self._spool.last_id

    async def close(self) -> None:
        """Close the spool and end the thread."""
        await self.call(lambda spool: spool.close())
        self._thread.shutdown(wait=False)
