"""Notices on disk: one for each state of a subject, kept until every receiver has it.

A small SQLite file in the data directory, so that a restart neither repeats nor forgets a notice.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from fieldlink.notices.notice import Notice, summary_notice
from fieldlink.store.damage import is_corruption, set_aside

__all__ = ["Delivery", "Outbox", "Retrying"]

HOUR_MS = 3_600_000

KEPT_MS = 90 * 24 * HOUR_MS
"""How long sent notices are remembered: longer than any receiver is away."""

_TABLES = """
CREATE TABLE IF NOT EXISTS told (
    subject TEXT PRIMARY KEY, state TEXT NOT NULL, utc_ms INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS notices (
    id INTEGER PRIMARY KEY, utc_ms INTEGER NOT NULL, held INTEGER NOT NULL, body TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS deliveries (
    notice INTEGER NOT NULL, receiver TEXT NOT NULL, attempts INTEGER NOT NULL,
    due_ms INTEGER NOT NULL, PRIMARY KEY (notice, receiver));
"""


@dataclass(frozen=True, slots=True)
class Retrying:
    """How often a notice is tried.

    Attributes:
        first: seconds until the second attempt.
        factor: by which each pause is longer than the one before.
        attempts: in all; with these values the last is three hours after the first, when people
            have learnt of the finding otherwise.
    """

    first: float = 10.0
    factor: float = 3.0
    attempts: int = 8

    def pause(self, attempts: int) -> float:
        """Return the seconds to wait after so many failed attempts."""
        return float(self.first * self.factor ** (attempts - 1))


@dataclass(frozen=True, slots=True)
class Delivery:
    """A notice that a receiver is to get; ``attempts`` have failed."""

    number: int
    notice: Notice
    attempts: int


class Outbox:
    """Keeps notices; every method may raise `sqlite3.Error`.

    Args:
        file: the SQLite file.
        receivers: names of those who get every notice.
        per_hour: most notices in an hour.
        retrying: see `Retrying`.
    """

    def __init__(
        self,
        file: Path,
        receivers: Sequence[str],
        *,
        per_hour: int,
        retrying: Retrying | None = None,
    ) -> None:
        self._file, self._receivers, self._per_hour = file, tuple(receivers), per_hour
        self._retrying = retrying or Retrying()

    def open(self) -> Path | None:
        """Make the tables; return where a damaged file was put, None where none was."""
        try:
            self._make()
            is_sound = self._is_sound()
        except sqlite3.Error as error:
            if not is_corruption(error):
                raise
            is_sound = False
        if is_sound:
            return None
        aside = set_aside(self._file)
        self._make()
        return aside

    def offer(self, notice: Notice, *, only_after: str = "") -> bool:
        """Take a notice; False where this state of its subject was sent already.

        Args:
            notice: to be sent.
            only_after: the state that must have been sent last; any when empty.
        """
        with closing(self._connect()) as connection, connection:
            row = connection.execute(
                "SELECT state FROM told WHERE subject = ?", (notice.subject,)
            ).fetchone()
            before = "" if row is None else str(row[0])
            if before == notice.state or (only_after and before != only_after):
                return False
            connection.execute(
                "INSERT OR REPLACE INTO told VALUES (?, ?, ?)",
                (notice.subject, notice.state, notice.utc_ms),
            )
            self._insert(connection, notice, held=not self._has_room(connection, notice.utc_ms))
        return True

    def release(self, site: str, page: str, now_ms: int) -> None:
        """Make one notice of those that were held, once the hour has room; forget old ones."""
        with closing(self._connect()) as connection, connection:
            rows = connection.execute(
                "SELECT id, body FROM notices WHERE held = 1 ORDER BY id"
            ).fetchall()
            if rows and self._has_room(connection, now_ms):
                held = [Notice.of_dict(json.loads(body)) for _, body in rows]
                connection.executemany("DELETE FROM notices WHERE id = ?", [(n,) for n, _ in rows])
                one = held[0] if len(held) == 1 else summary_notice(held, site, page, now_ms)
                self._insert(connection, one, held=False)
            old = (now_ms - KEPT_MS,)
            connection.execute(
                "DELETE FROM told WHERE utc_ms < ? AND subject LIKE 'finding/%'", old
            )
            connection.execute(
                "DELETE FROM notices WHERE utc_ms < ? AND id NOT IN "
                "(SELECT notice FROM deliveries)",
                old,
            )

    def next_due(self, receiver: str, now_ms: int) -> Delivery | None:
        """Return the oldest notice that a receiver is to get now."""
        longest = round(1000.0 * self._retrying.pause(self._retrying.attempts))
        with closing(self._connect()) as connection:
            row = connection.execute(
                # a due time beyond every pause was set by a clock that has stepped back since
                "SELECT n.id, n.body, d.attempts FROM deliveries d JOIN notices n "
                "ON n.id = d.notice WHERE d.receiver = ? AND (d.due_ms <= ? OR d.due_ms > ?) "
                "ORDER BY n.id LIMIT 1",
                (receiver, now_ms, now_ms + longest),
            ).fetchone()
        if row is None:
            return None
        return Delivery(int(row[0]), Notice.of_dict(json.loads(row[1])), int(row[2]))

    def delivered(self, receiver: str, number: int) -> None:
        """Note that a receiver has a notice."""
        self._end(receiver, number)

    def failed(self, receiver: str, delivery: Delivery, now_ms: int) -> bool:
        """Note a failed attempt; True when it was the last one."""
        attempts = delivery.attempts + 1
        if attempts >= self._retrying.attempts:
            self._end(receiver, delivery.number)
            return True
        due = now_ms + round(1000.0 * self._retrying.pause(attempts))
        with closing(self._connect()) as connection, connection:
            connection.execute(
                "UPDATE deliveries SET attempts = ?, due_ms = ? WHERE notice = ? AND receiver = ?",
                (attempts, due, delivery.number, receiver),
            )
        return False

    def held(self) -> int:
        """Return how many notices wait for the hour to be over."""
        with closing(self._connect()) as connection:
            return int(
                connection.execute("SELECT count(*) FROM notices WHERE held = 1").fetchone()[0]
            )

    def _has_room(self, connection: sqlite3.Connection, now_ms: int) -> bool:
        count = connection.execute(
            "SELECT count(*) FROM notices WHERE held = 0 AND utc_ms > ? AND utc_ms <= ?",
            (now_ms - HOUR_MS, now_ms),
        ).fetchone()[0]
        return int(count) < self._per_hour

    def _insert(self, connection: sqlite3.Connection, notice: Notice, *, held: bool) -> None:
        number = connection.execute(
            "INSERT INTO notices (utc_ms, held, body) VALUES (?, ?, ?)",
            (notice.utc_ms, held, json.dumps(notice.to_dict())),
        ).lastrowid
        if not held:
            connection.executemany(
                "INSERT INTO deliveries VALUES (?, ?, 0, 0)",
                [(number, receiver) for receiver in self._receivers],
            )

    def _end(self, receiver: str, number: int) -> None:
        with closing(self._connect()) as connection, connection:
            connection.execute(
                "DELETE FROM deliveries WHERE notice = ? AND receiver = ?", (number, receiver)
            )

    def _make(self) -> None:
        self._file.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
        with closing(self._connect()) as connection:
            connection.executescript(_TABLES)
            # receivers that the site file no longer names
            names = ", ".join("?" for _ in self._receivers)
            with connection:
                connection.execute(
                    f"DELETE FROM deliveries WHERE receiver NOT IN ({names})",
                    self._receivers,
                )
        self._file.chmod(0o640)

    def _is_sound(self) -> bool:
        """Whether every page can be read: the tables are small, and a damaged page stops all."""
        with closing(self._connect()) as connection:
            return bool(connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok")

    def _connect(self) -> sqlite3.Connection:
        return sqlite3.connect(self._file, timeout=5.0)
