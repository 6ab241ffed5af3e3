"""Whose turn it is to use a device: one request at a time, writes before reads, else in order."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count

__all__ = ["Turns"]


class Turns:
    """A lock whose urgent waiters overtake the others.

    async with turns.take(urgent=True):
        ...
    """

    def __init__(self) -> None:
        self._busy = False
        self._arrivals = count()
        self._waiting: list[tuple[bool, int, asyncio.Future[None]]] = []

    @property
    def is_wanted(self) -> bool:
        """Whether somebody waits for the turn."""
        return any(not turn.done() for _, _, turn in self._waiting)

    @asynccontextmanager
    async def take(self, *, urgent: bool = False) -> AsyncIterator[None]:
        """Wait for the turn, hold it inside the block, hand it on afterwards."""
        await self.acquire(urgent=urgent)
        try:
            yield
        finally:
            self.release()

    async def acquire(self, *, urgent: bool = False) -> None:
        """Wait for the turn; `release` has to follow. `take` does both, a little slower."""
        if not self._busy:
            self._busy = True
            return
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._waiting, (not urgent, next(self._arrivals), turn))
        try:
            await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                # The turn came in the very moment of the cancellation: it must not be lost.
                self.release()
            raise

    def release(self) -> None:
        """Hand the turn on."""
        while self._waiting:
            turn = heapq.heappop(self._waiting)[2]
            if not turn.done():
                turn.set_result(None)
                return
        self._busy = False
