"""Who writes a historian: each daemon has a row with its loops, so that no loop has two writers.

Every batch counts up the row's ``beat`` in its own transaction: it is a sign of life, and a batch
of a writer whose row is gone is rolled back. A second writer of a loop is refused while the beat of
the first goes on. Whether it does is timed by the one who looks, with a clock of its own: clocks of
two machines need not agree. After kill -9 the same data directory goes on at once, because its lock
proves that the writer before is dead; any other one after `HistorianSettings.expires` seconds.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, RowMapping, delete, insert, select, update

from fieldlink.store.errors import StoreInUseError
from fieldlink.store.schema import META, WRITERS

__all__ = ["Claim", "Writer"]

NAMED = 3
"""Loops that a message names."""


@dataclass(frozen=True, slots=True)
class Writer:
    """A daemon as it is known to others.

    Attributes:
        data_dir: its data directory, which it holds.
        identity: of that directory, see `fieldlink.daemon.installation`.
        loops: what it writes.
        since_ms: since when, for people.
        host, process: where it runs, for people.
    """

    data_dir: Path
    identity: int
    loops: frozenset[str]
    since_ms: int
    host: str = field(default_factory=socket.gethostname)
    process: int = field(default_factory=os.getpid)

    @property
    def installation(self) -> str:
        """What stays the same when the daemon begins again."""
        return f"{self.identity} {self.data_dir}"


class Claim:
    """The right of one process to write its loops; every database it meets gets a row.

    Args:
        writer: who claims.
        expires: seconds without a beat after which another writer counts as dead.
        where: the historian, for messages.
    """

    def __init__(self, writer: Writer, expires: float, where: str) -> None:
        self._writer = writer
        self._expires = expires
        self._where = where
        self._session = secrets.token_hex(16)
        self._loops = writer.loops
        self._written: frozenset[str] | None = None
        self._began = False
        self._seen: dict[str, tuple[int, float]] = {}
        self._renewed = -float("inf")

    def follow(self, loops: Iterable[str]) -> None:
        """Claim other loops from the next renewal on."""
        self._loops = frozenset(loops)

    def is_due(self, every: float) -> bool:
        """Whether nothing has been renewed for so many seconds."""
        return time.monotonic() - self._renewed >= every

    def renew(self, connection: Connection) -> None:
        """Count up the beat, in the transaction of what is written; claim again where it is gone.

        Raises:
            StoreInUseError: another writer has one of the loops.
        """
        if self._written != self._loops or not self._beat(connection):
            self.take(connection)
        self._renewed = time.monotonic()

    def take(self, connection: Connection) -> None:
        """Write the row, once no other writer has one of the loops.

        Raises:
            StoreInUseError: another writer has one of them, or may still have it.
        """
        # One claim at a time, in every database: who comes second waits for this row.
        connection.execute(update(META).where(META.c.key == "schema").values(key=META.c.key))
        writer, loops = self._writer, self._loops
        for other in connection.execute(select(WRITERS)).mappings().all():
            if self._is_over(other, loops):
                connection.execute(delete(WRITERS).where(WRITERS.c.session == other["session"]))
        row = {
            "session": self._session,
            "installation": writer.installation,
            "host": writer.host,
            "data_dir": str(writer.data_dir),
            "process": writer.process,
            "since_ms": writer.since_ms,
            "loops": sorted(loops),
            "beat": 0,
        }
        connection.execute(insert(WRITERS), row)
        self._written, self._began = loops, True
        self._renewed = time.monotonic()

    def release(self, connection: Connection) -> None:
        """Take the row away, so that the next writer need not wait for its end."""
        connection.execute(delete(WRITERS).where(WRITERS.c.session == self._session))
        self._written = None

    def _beat(self, connection: Connection) -> bool:
        mine = WRITERS.c.session == self._session
        done = connection.execute(update(WRITERS).where(mine).values(beat=WRITERS.c.beat + 1))
        return done.rowcount == 1

    def _is_over(self, other: RowMapping, loops: frozenset[str]) -> bool:
        """Whether a row is of a writer that has ended; False where it does not concern us.

        Raises:
            StoreInUseError: it has one of our loops, and is alive or may be.
        """
        if other["session"] == self._session:
            return True
        if not self._began and other["installation"] == self._writer.installation:
            return True
        shared = sorted(loops.intersection(other["loops"]))
        if not shared:
            return False
        beat, now = int(other["beat"]), time.monotonic()
        before, since = self._seen.setdefault(other["session"], (beat, now))
        if beat == before and now - since >= self._expires:
            return True
        self._seen[other["session"]] = (beat, since if beat == before else now)
        raise StoreInUseError(self._refusal(other, shared), alive=beat != before)

    def _refusal(self, other: RowMapping, shared: list[str]) -> str:
        since = datetime.fromtimestamp(other["since_ms"] / 1000.0, UTC)
        what = "loop" if len(shared) == 1 else "loops"
        loops = ", ".join(shared[:NAMED]) + (", ..." if len(shared) > NAMED else "")
        return (
            f"the historian {self._where} gets {what} {loops} from another "
            f"daemon since {since:%Y-%m-%d %H:%M} UTC (host {other['host']}, process "
            f"{other['process']}, data_dir {other['data_dir']}); stop that daemon, or give one of "
            "the two a historian of its own (historian.url)"
        )
