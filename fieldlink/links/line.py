"""A line: what carries the requests of one or several devices, one request at a time.

A network device has a line of its own. Devices on one serial port, behind one gateway with RTU
framing, or at one address with too few connections, share a line: there is one wire, and they take
turns.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from weakref import WeakKeyDictionary, WeakSet, WeakValueDictionary

from fieldlink.links.clock import Clock
from fieldlink.links.turns import Turns
from fieldlink.links.wire import Wire

__all__ = ["Line", "LineSettings", "Lines"]

MakeWire = Callable[[], Wire]

SILENT_LIMIT = 3
"""Time-outs in a row, of whatever unit, after which a shared line is opened again."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How a line is opened and paced.

    Attributes:
        make_wire: makes a wire that is not open yet; called in a running event loop.
        numbered: whether replies name their transaction (not on RTU framing).
        keeps_open: whether a time-out leaves the wire open, because late replies are recognised.
        key: what identifies the medium where devices share it; None for a line of one device.
        place: host and port that a connection is made to; None where there is none.
        timeout: seconds for opening.
        pause_after_connect: seconds between opening and the first request.
        gap: least seconds from the end of a reply to the next request.
        per_byte: seconds that each byte is on a serial line; a device's time-out comes on top.
    """

    make_wire: MakeWire
    numbered: bool
    keeps_open: bool
    key: Hashable = None
    place: Hashable = None
    timeout: float = 0.5
    pause_after_connect: float = 0.0
    gap: float = 0.0
    per_byte: float = 0.0


class Line:
    """One medium and its wire.

    Args:
        settings: how it is opened and paced.
        clock: for the pauses.

    Attributes:
        turns: whose turn it is.
        connects: how often the line was opened.
        closes_after_answer: whether the other side was seen to close after each answer; every
            request then has a connection of its own, so that none meets the closing of one.
    """

    def __init__(self, settings: LineSettings, clock: Clock) -> None:
        self.settings = settings
        self.turns = Turns()
        self.connects = 0
        self.closes_after_answer = False
        self._clock = clock
        self._wire: Wire | None = None
        self._free_at = 0.0
        self._silent = 0
        self._users = 0

    @property
    def is_open(self) -> bool:
        """Whether there is a wire that requests can be sent on."""
        return self._wire is not None and self._wire.is_open

    def join(self) -> None:
        """Note one more device that uses the line."""
        self._users += 1

    def leave(self) -> None:
        """Note that a device has gone; the last one closes the wire."""
        self._users = max(0, self._users - 1)
        if self._users == 0:
            self.drop()

    async def wire(self) -> Wire:
        """Return the open wire; opens it, and keeps the pauses. The caller has the turn.

        Raises:
            WireLostError: it cannot be opened.
        """
        if self._wire is not None and self._wire.is_open and not self._is_used_up(self._wire):
            await self._pause_until(self._free_at)
            return self._wire
        self.drop()
        wire = self.settings.make_wire()
        self._wire = wire
        try:
            await wire.open(self.settings.timeout)
        except BaseException:
            self.drop()
            # Perhaps it is another device that answers there next time.
            self.closes_after_answer = False
            raise
        self.connects += 1
        await self._pause_until(self._clock.monotonic() + self.settings.pause_after_connect)
        return wire

    def answered(self) -> None:
        """Note that something was answered."""
        self._silent = 0
        self._begin_gap()

    def unanswered(self) -> None:
        """Note a time-out: drop a wire on which a late reply looks like another."""
        self._silent += 1
        self._begin_gap()
        if not self.settings.keeps_open or self._silent >= SILENT_LIMIT:
            self._silent = 0
            self.drop()

    def drop(self) -> None:
        """Close the wire; the next request opens one."""
        wire, self._wire = self._wire, None
        if wire is not None:
            wire.close()

    def closed(self, wire: Wire) -> None:
        """Note that the other side closed a wire while it was asked, and drop it."""
        if wire.answers == 1:
            self.closes_after_answer = True
        self.drop()

    def _is_used_up(self, wire: Wire) -> bool:
        return self.closes_after_answer and wire.answers > 0

    def _begin_gap(self) -> None:
        if self.settings.gap:
            self._free_at = self._clock.monotonic() + self.settings.gap

    async def _pause_until(self, moment: float) -> None:
        if moment > self._clock.monotonic():
            await self._clock.sleep_until(moment)


class Lines:
    """The lines of each event loop; the shared ones by what identifies their medium."""

    def __init__(self) -> None:
        self._lines: WeakKeyDictionary[
            asyncio.AbstractEventLoop, WeakValueDictionary[Hashable, Line]
        ] = WeakKeyDictionary()
        self._all: WeakKeyDictionary[asyncio.AbstractEventLoop, WeakSet[Line]] = WeakKeyDictionary()

    def line(self, settings: LineSettings, clock: Clock) -> Line:
        """Return the line of a device; the first to ask for a shared one decides its settings."""
        loop = asyncio.get_running_loop()
        lines = self._lines.setdefault(loop, WeakValueDictionary())
        line = None if settings.key is None else lines.get(settings.key)
        if line is None:
            line = Line(settings, clock)
            self._all.setdefault(loop, WeakSet()).add(line)
            if settings.key is not None:
                lines[settings.key] = line
        return line

    def open_beside(self, line: Line) -> int:
        """Return how many other lines have a connection to the same host and port now."""
        place = line.settings.place
        if place is None:
            return 0
        others = self._all.get(asyncio.get_running_loop(), WeakSet[Line]())
        return sum(
            other is not line and other.settings.place == place and other.is_open
            for other in others
        )
