"""Messages on disk until every format has delivered them: bounded, in order, each with a number.

One SQLite file. Numbers rise by one and never come back, also after a restart; a file that had to
be replaced begins a new stream with a name of its own. So a consumer that keeps the last number of
a stream can drop repeats and see gaps. All methods run in one thread, which is the caller's care.

SQLite finds a damaged page when it reads it, which may be long after the file was opened: whatever
meets the damage replaces the file.
"""

from __future__ import annotations

import json
import sqlite3
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from fieldlink.store.damage import is_corruption, set_aside
from fieldlink.store.errors import StoreError
from fieldlink.store.housekeeping import RetentionClock
from fieldlink.upward.errors import UpwardError
from fieldlink.upward.messages import LEFT, Message

__all__ = ["Spool"]

T = TypeVar("T")

_SCHEMA = """
CREATE TABLE IF NOT EXISTS messages (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    utc_ms INTEGER NOT NULL, kind TEXT NOT NULL, source TEXT NOT NULL, body TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS readers (name TEXT PRIMARY KEY, confirmed INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""

BUSY = 5.0
"""Seconds to wait for another program that has the file open, such as a backup."""

FILE_MODE = 0o640
"""For the owner to write and the group to read, like the store."""

SHARE_DROPPED = 0.1
"""Share of the messages that goes at once when the bound is reached: not one at a time."""

AT_ONCE = 50
"""Topics in one message of those that were left: some milliseconds of the event loop."""

_RETAINED = "retained"
"""Key of the topics on which the broker keeps something."""

LARGEST_BIRTH = 256
"""bdSeq counts from 0 to 255 (Sparkplug 3.0, section 6.4.19)."""


class Spool:
    """The file.

    Args:
        file: its path; its folder exists.
        readers: the formats that deliver; what all of them have confirmed is deleted.
        most_bytes: size of the messages and their pages above which the oldest go.
        longest: seconds after which a message goes.
        clock: the time by which messages grow old.

    Attributes:
        stream: name of this file's numbering.
        last_id: number of the newest message; 0 before the first.
        dropped: messages that went undelivered.
        set_aside: damaged files that were replaced.
    """

    def __init__(
        self,
        file: Path,
        readers: Sequence[str],
        *,
        most_bytes: int,
        longest: float,
        clock: RetentionClock | None = None,
    ) -> None:
        self._file = file
        self._readers = tuple(readers)
        self._most_bytes = most_bytes
        self._longest = longest
        self._clock = clock or RetentionClock()
        self._open_file: sqlite3.Connection | None = None
        self.stream = ""
        self.last_id = 0
        self.dropped = 0
        self.set_aside = 0

    def open(self) -> None:
        """Open the file; a damaged one is set aside and a new one begun.

        Raises:
            UpwardError: it cannot be opened or replaced.
        """
        try:
            self._try_open()
        except sqlite3.Error as error:
            self.close()
            if not is_corruption(error):
                raise self._unusable(error) from error
            self._replace()

    def close(self) -> None:
        """Close the file; may be called twice."""
        connection, self._open_file = self._open_file, None
        if connection is not None:
            connection.close()

    def append(self, messages: Sequence[Message]) -> int:
        """Store messages in order; return the number of the last one.

        Raises:
            sqlite3.Error: the file cannot be written; nothing of these is stored.
            UpwardError: a damaged file cannot be replaced.
        """
        rows = [(m.utc_ms, m.kind, m.source, json.dumps(m.body, default=str)) for m in messages]
        self._heal(lambda: self._insert(rows))
        return self.last_id

    def retain(self, topics: Sequence[str]) -> int:
        """Note the topics on which the broker keeps something from now on.

        Those of before that are not among them, as of a loop that has left the site or changed its
        area, become messages of the kind `LEFT`.

        Returns:
            How many topics that are.

        Raises:
            sqlite3.Error, UpwardError: as `append`.
        """
        return self._heal(lambda: self._retain(topics))

    def _retain(self, topics: Sequence[str]) -> int:
        gone = sorted(set(json.loads(self._meta(_RETAINED, "[]"))).difference(topics))
        rows = [
            (round(1000.0 * time.time()), LEFT, "", json.dumps({"topics": gone[at : at + AT_ONCE]}))
            for at in range(0, len(gone), AT_ONCE)
        ]
        with self._connection as connection:
            connection.execute(
                "INSERT OR REPLACE INTO meta VALUES (?, ?)", (_RETAINED, json.dumps(topics))
            )
            newest = self._add(connection, rows)
        self.last_id = newest
        return len(gone)

    def read(self, after: int, limit: int) -> list[Message]:
        """Return up to ``limit`` messages with numbers above ``after``, in order."""
        rows = self._heal(lambda: self._rows(after, limit))
        return [
            Message(kind, source, ms, json.loads(body), n) for n, ms, kind, source, body in rows
        ]

    def confirmed(self, reader: str) -> int:
        """Return the number up to which a reader has delivered."""
        row = self._heal(
            lambda: self._connection.execute(
                "SELECT confirmed FROM readers WHERE name = ?", (reader,)
            ).fetchone()
        )
        return int(row[0])

    def waiting(self, reader: str) -> int:
        """Return how many messages a reader has not delivered."""
        row = self._heal(
            lambda: self._connection.execute(
                "SELECT count(*) FROM messages WHERE id > ?", (self.confirmed(reader),)
            ).fetchone()
        )
        return int(row[0])

    def confirm(self, reader: str, up_to: int, stream: str) -> None:
        """Note that a reader has delivered; delete what every reader has.

        Args:
            reader: its name.
            up_to: number of its last message.
            stream: of that number; in a file that was replaced since it means nothing.
        """
        self._heal(lambda: self._confirm(reader, up_to) if stream == self.stream else None)

    def _confirm(self, reader: str, up_to: int) -> None:
        with self._connection as connection:
            connection.execute(
                "UPDATE readers SET confirmed = max(confirmed, ?) WHERE name = ?", (up_to, reader)
            )
            connection.execute(
                "DELETE FROM messages WHERE id <= (SELECT min(confirmed) FROM readers)"
            )

    def trim(self) -> int:
        """Drop what is too old or too much; return how many messages that were."""
        return self._heal(self._trim)

    def _trim(self) -> int:
        oldest = round(1000.0 * (self._clock.now() - self._longest))
        with self._connection as connection:
            # Numbers, not times, decide what is old: a clock that stepped must not tear the order.
            row = connection.execute(
                "SELECT id FROM messages WHERE utc_ms >= ? ORDER BY id LIMIT 1", (oldest,)
            ).fetchone()
            first_kept = self.last_id + 1 if row is None else row[0]
            gone = connection.execute("DELETE FROM messages WHERE id < ?", (first_kept,)).rowcount
            if self._used_bytes() > self._most_bytes:
                first, last = connection.execute("SELECT min(id), max(id) FROM messages").fetchone()
                bound = first + max(1, round(SHARE_DROPPED * (last - first + 1)))
                gone += connection.execute("DELETE FROM messages WHERE id < ?", (bound,)).rowcount
        self.dropped += gone
        return gone

    def next_birth(self, reader: str) -> int:
        """Return the number of a reader's next session (bdSeq); a new process goes on counting."""
        return self._heal(lambda: self._next_birth(f"birth of {reader}"))

    def _next_birth(self, key: str) -> int:
        with self._connection as connection:
            number = (int(self._meta(key, "-1")) + 1) % LARGEST_BIRTH
            connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, str(number)))
        return number

    @property
    def _connection(self) -> sqlite3.Connection:
        assert self._open_file is not None, "the spool is not open"
        return self._open_file

    def _try_open(self) -> None:
        # SQLite gives its companions the same permissions. What prevents this prevents opening it.
        with suppress(OSError):
            self._file.touch(mode=FILE_MODE)
        self._open_file = connection = sqlite3.connect(
            self._file, timeout=BUSY, check_same_thread=False
        )
        connection.execute("PRAGMA journal_mode = WAL")
        # A power cut may cost the newest messages of a second, never the file.
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.executescript(_SCHEMA)
        with connection:
            self.stream = self._meta("stream", "") or uuid.uuid4().hex[:12]
            connection.execute("INSERT OR REPLACE INTO meta VALUES ('stream', ?)", (self.stream,))
            # A reader of before that the site has no more must not hold messages back, and a new
            # one begins with what comes now.
            marks = ", ".join("?" for _ in self._readers)
            connection.execute(f"DELETE FROM readers WHERE name NOT IN ({marks})", self._readers)
            self.last_id = self._newest()
            connection.executemany(
                "INSERT OR IGNORE INTO readers VALUES (?, ?)",
                [(name, self.last_id) for name in self._readers],
            )

    def _newest(self) -> int:
        row = self._connection.execute(
            "SELECT seq FROM sqlite_sequence WHERE name = 'messages'"
        ).fetchone()
        return 0 if row is None else int(row[0])

    def _heal(self, work: Callable[[], T]) -> T:
        """Return what ``work`` gives; a file that it finds damaged is replaced, and it done again.

        Raises:
            sqlite3.Error: the file cannot be used, for another reason than damage.
            UpwardError: a damaged file cannot be replaced; the next call tries again.
        """
        if self._open_file is None:
            self.open()
        try:
            return work()
        except sqlite3.Error as error:
            if not is_corruption(error):
                raise
            self.close()
            self._replace()
            return work()

    def _rows(self, after: int, limit: int) -> list[tuple[int, int, str, str, str]]:
        return self._connection.execute(
            "SELECT id, utc_ms, kind, source, body FROM messages WHERE id > ? ORDER BY id LIMIT ?",
            (after, limit),
        ).fetchall()

    def _insert(self, rows: Sequence[tuple[int, str, str, str]]) -> None:
        with self._connection as connection:
            newest = self._add(connection, rows)
        self.last_id = newest

    def _add(
        self, connection: sqlite3.Connection, rows: Sequence[tuple[int, str, str, str]]
    ) -> int:
        connection.executemany(
            "INSERT INTO messages (utc_ms, kind, source, body) VALUES (?, ?, ?, ?)", rows
        )
        return self._newest()

    def _replace(self) -> None:
        try:
            set_aside(self._file)
        except StoreError as error:
            raise UpwardError(str(error)) from error
        self.set_aside += 1
        try:
            self._try_open()
        except sqlite3.Error as error:
            self.close()
            raise self._unusable(error) from error

    def _unusable(self, error: sqlite3.Error) -> UpwardError:
        return UpwardError(f"{self._file}: {error}; check the disk and the folder")

    def _meta(self, key: str, default: str) -> str:
        row = self._connection.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return default if row is None else str(row[0])

    def _used_bytes(self) -> int:
        def pragma(name: str) -> int:
            return int(self._connection.execute(f"PRAGMA {name}").fetchone()[0])

        return (pragma("page_count") - pragma("freelist_count")) * pragma("page_size")
