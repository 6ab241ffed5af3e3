"""Names of hosts into addresses, each in a thread of its own.

The system's resolver blocks: for tens of seconds where no name server answers. asyncio asks it in
the few threads that the whole process shares, where the names of some dead devices would keep every
other device, the store and the pages waiting.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass, field

__all__ = ["find_addresses"]

FRESH = 60.0
"""Seconds for which an answer that came too late for one attempt serves the next: long beside the
pauses between attempts, short beside the time in which an address goes to another device."""


@dataclass(frozen=True, slots=True)
class _LookUp:
    answer: Future[tuple[str, ...]] = field(default_factory=Future)
    asked_at: float = field(default_factory=time.monotonic)

    @property
    def is_stale(self) -> bool:
        return self.answer.done() and time.monotonic() - self.asked_at > FRESH


_under_way: dict[str, _LookUp] = {}
_guard = threading.Lock()


async def find_addresses(host: str) -> tuple[str, ...]:
    """Return the addresses of a host, in the resolver's order; an address is its own.

    A caller may give up at any time: the answer then serves the next one who asks.

    Raises:
        OSError: the resolver knows no address.
        ValueError: ``host`` cannot be a name.
    """
    try:
        ipaddress.ip_address(host)
    except ValueError:
        pass
    else:
        return (host,)
    with _guard:
        found = _under_way.get(host)
        if found is None or found.is_stale:
            found = _under_way[host] = _LookUp()
            found.answer.set_running_or_notify_cancel()
            threading.Thread(
                target=_resolve, args=(host, found.answer), name=f"name {host}", daemon=True
            ).start()
    try:
        return await asyncio.wrap_future(found.answer)
    finally:
        with _guard:
            if found.answer.done() and _under_way.get(host) is found:
                del _under_way[host]


def _resolve(host: str, answer: Future[tuple[str, ...]]) -> None:
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, ValueError) as error:
        answer.set_exception(error)
        return
    answer.set_result(tuple(dict.fromkeys(_written(place) for *_, place in found)))


def _written(place: tuple[object, ...]) -> str:
    """Return an address with its zone, without which a link-local one cannot be reached."""
    address, zone = str(place[0]), place[3] if len(place) > 3 else 0
    return f"{address}%{zone}" if zone and "%" not in address else address
