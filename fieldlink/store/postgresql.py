"""What differs when the historian is on a PostgreSQL server: how long it may be silent.

A file on this machine answers or fails. A server can also be out of reach without a word: the
network is cut, its machine is switched off, or a table is locked. Without the bounds below the
operating system tries for a quarter of an hour, and no message comes meanwhile.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from sqlalchemy import Engine, event
from sqlalchemy.engine import URL

__all__ = ["bound_lock_waits", "connection_patience", "is_refusal_of_the_server"]

SILENCE = 15.0
"""Seconds without a sign of the server's machine after which a connection counts as dead.

Longer than a switch takes to find another way (rapid spanning tree: a few seconds), shorter than
the queue lasts at any load that was measured (seven minutes)."""

PROBE = 5.0
"""Seconds between two probes of a connection on which an answer is waited for."""

_REFUSALS = frozenset({"25006", "42501"})
"""SQLSTATEs (PostgreSQL manual, appendix A) of a server that takes no rows for now: a transaction
that may only read (a stand-by after a switch-over, a disk that is nearly full), no rights."""


def connection_patience(address: URL, connecting: float) -> dict[str, float]:
    """Return libpq's parameters (manual, 34.1.2) that bound the waiting for a silent server.

    Args:
        address: of the database; what it says itself stays as it says.
        connecting: seconds to wait for a connection.
    """
    bounds = {
        "connect_timeout": max(2, round(connecting)),
        "tcp_user_timeout": round(1000 * SILENCE),
        "keepalives_idle": round(PROBE),
        "keepalives_interval": round(PROBE),
        "keepalives_count": round(SILENCE / PROBE),
    }
    return {name: value for name, value in bounds.items() if name not in address.query}


def bound_lock_waits(engine: Engine, seconds: float) -> None:
    """Let every connection from now on wait at most so long for another program's lock."""
    event.listen(engine, "connect", partial(_set_lock_timeout, round(1000 * seconds)))
    # The connection there is has no bound.
    engine.dispose()


def is_refusal_of_the_server(error: Exception) -> bool:
    """Whether the server takes no rows at all for now, whatever stands in them."""
    return getattr(getattr(error, "orig", None), "sqlstate", None) in _REFUSALS


def _set_lock_timeout(milliseconds: int, connection: Any, _record: object) -> None:
    with connection.cursor() as cursor:
        cursor.execute(f"SET lock_timeout = {milliseconds}")
    connection.commit()
