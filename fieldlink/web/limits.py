"""What strangers may take: a number of connections, seconds for a request, a log line a minute.

The endpoints share the daemon's event loop and its file descriptors. A connection that sends half
a request, or nothing, must not keep the next one out, nor the daemon from reaching its devices.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from fieldlink.once_a_minute import OnceAMinute

__all__ = ["MOST_CONNECTIONS", "REQUEST_TIME", "BoundedListener", "QuietLog", "TimedProtocol"]

MOST_CONNECTIONS = 32
"""Open connections: some scrapers, a page, a person; when one more comes the oldest has to go."""

REQUEST_TIME = 10.0
"""Seconds from the opening of a connection, or its last answer, to the end of the next answer."""


class BoundedListener(socket.socket):
    """A listening socket that keeps at most so many of its connections open.

    The bound counts from the first packet, so that TLS handshakes which are never finished count.
    """

    most = MOST_CONNECTIONS

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._accepted: list[socket.socket] = []

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection; the oldest one is ended when there are too many."""
        connection, address = super().accept()
        self._accepted = [known for known in self._accepted if known.fileno() != -1]
        while len(self._accepted) >= self.most:
            with contextlib.suppress(OSError):
                # Its transport sees the end of the stream and closes it.
                self._accepted.pop(0).shutdown(socket.SHUT_RDWR)
        self._accepted.append(connection)
        return connection, address


class TimedProtocol(H11Protocol):
    """An HTTP connection that is ended when a request takes too long, to be sent or answered."""

    seconds = REQUEST_TIME
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Part of asyncio's protocol."""
        super().connection_made(transport)
        self._wind_up()

    def connection_lost(self, exc: Exception | None) -> None:
        """Part of asyncio's protocol."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Part of uvicorn's protocol: an answer was sent."""
        super().on_response_complete()
        self._wind_up()

    def _wind_up(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(self.seconds, self.transport.abort)


class QuietLog(logging.Filter):
    """Lets each message of a logger through once a minute, with the number of those held back."""

    def __init__(self) -> None:
        super().__init__()
        self._limit = OnceAMinute()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record is to be logged."""
        number = self._limit.note(record.msg)
        if number > 1:
            record.msg = f"{record.getMessage()} ({number - 1} more of these since the last line)"
            record.args = ()
        return number > 0
