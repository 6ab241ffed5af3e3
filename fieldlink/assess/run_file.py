"""The file of a run: what is to be read, what has been, and the rows so far, in one SQLite file.

A batch's rows and the fact that it is done are one transaction, so that a run that ends in any way
at any moment goes on where it was. The table is sorted by SQLite on disk: no table has to fit in
memory.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldlink.assess.errors import AssessError
from fieldlink.assess.histories import history_of
from fieldlink.assess.job import Piece
from fieldlink.assess.table_row import COLUMNS, KEPT
from fieldlink.assess.trends import NEWEST

__all__ = ["Counts", "RunFile", "Task"]

_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS pieces (
    id INTEGER PRIMARY KEY, piece TEXT NOT NULL, done INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE IF NOT EXISTS windows (
    piece INTEGER NOT NULL, number INTEGER NOT NULL, {", ".join(KEPT)},
    PRIMARY KEY (piece, number)
) WITHOUT ROWID;
"""

_HISTORIES = """
CREATE TEMP TABLE histories AS
SELECT file, history_of(file, MIN(CASE WHEN start LIKE '%Z' THEN start END)) AS history
FROM windows GROUP BY file;
CREATE UNIQUE INDEX temp.history_of_file ON histories (file);
CREATE INDEX temp.files_of_history ON histories (history);
"""
"""The files of which each history consists, as far as their paths tell."""

_APART = """
UPDATE temp.histories SET history = file WHERE history IN (
    SELECT history FROM (
        SELECT history, loop,
            MIN(till, LAG(till) OVER before) - since
                > 0.5 * MIN(till - since, LAG(till - since) OVER before) AS together
        FROM (
            SELECT history, loop, MIN(julianday(start)) AS since,
                MAX(julianday(start) + samples * period_s / 86400) AS till
            FROM windows JOIN temp.histories USING (file)
            WHERE start LIKE '%Z' AND history IN (
                SELECT history FROM temp.histories GROUP BY history HAVING COUNT(*) > 1
            )
            GROUP BY history, loop, file
        )
        WINDOW before AS (PARTITION BY history, loop ORDER BY since)
    )
    GROUP BY history, loop HAVING SUM(together) > 0.5 * COUNT(together)
);
"""
"""Files that record the same time are of different loops: the date in their names is a part of
tags (``FC-20260101``), or they are copies. Most of them have to, by half of the shorter one: one
day that was exported twice, or the hour that autumn repeats, does not part a year of files."""

_IN_TIME = "CASE WHEN w.start LIKE '%Z' THEN w.start END {0}, w.piece {0}, w.number {0}"
"""The order of a loop's windows: names of files need not be in that of time."""

_STANDING = f"""
CREATE TEMP TABLE standing AS
SELECT history, loop, file, files,
    CASE
        WHEN sticky > 0 AND sticky_now = 0 THEN 2
        WHEN sticky > 0 AND 2 * sticky >= judged OR sticky_now = {NEWEST} THEN 0
        WHEN sticky > 0 THEN 1
        WHEN judged > 0 THEN 3
        WHEN verdicts > 0 THEN 4
        ELSE 5
    END AS class,
    score, sticky, judged, verdicts, errors
FROM (
    SELECT history, loop,
        MIN(file) AS file,
        COUNT(DISTINCT file) AS files,
        SUM(verdict = 'stiction') AS sticky,
        SUM(verdict = 'stiction' AND newness <= {NEWEST}) AS sticky_now,
        SUM(judged) AS judged,
        COUNT(verdict) AS verdicts,
        COUNT(error) AS errors,
        AVG(score) AS score
    FROM (
        SELECT history, loop, file, verdict, judged, error, score,
            ROW_NUMBER() OVER (
                PARTITION BY history, loop, judged ORDER BY {_IN_TIME.format("DESC")}
            ) AS newness
        FROM (SELECT *, verdict IN ('stiction', 'no_stiction') AS judged FROM windows) AS w
        JOIN temp.histories USING (file)
    )
    GROUP BY history, loop
)
"""
"""Loops are ranked by whether their valve sticks now (in each of the newest judged windows, or in
half of all and not in none of the newest), then by whether it sticks at times, then by whether it
did once; then by the mean evidence."""

_RANKED = "s.class, s.score DESC NULLS LAST, s.history, s.loop"

CACHE_KILOBYTES = 20_000
"""What SQLite may keep in memory, sorting included."""

TOGETHER = 1_000
"""Pieces that are stored in one transaction while a run is planned."""

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Task:
    """A piece and its number in the run_file."""

    number: int
    piece: Piece


@dataclass(frozen=True, slots=True)
class Counts:
    """How far a run is: pieces and those done, rows and those with an error."""

    pieces: int
    done: int
    rows: int
    errors: int


class RunFile:
    """The file in a run's folder; one process at a time may have it open.

    Args:
        file: made when it is not there.

    Raises:
        AssessError: another process has it, or the file cannot be written.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        with self._explained():
            self._db = sqlite3.connect(file, isolation_level=None, timeout=1.0)
            # The lock is held until the end: two runs would take each other's work.
            self._db.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.execute(f"PRAGMA cache_size = -{CACHE_KILOBYTES}")
            self._db.execute("PRAGMA temp_store = FILE")
            self._db.execute("BEGIN EXCLUSIVE")
            self._db.execute("COMMIT")
            self._db.executescript(_SCHEMA)
            self._db.create_function("history_of", 2, history_of)
            self._add_new_columns()

    def _add_new_columns(self) -> None:
        """Give the file of a run that an older fieldlink began the columns that it lacks."""
        known = {name for _, name, *_ in self._db.execute("PRAGMA table_info(windows)")}
        for column in KEPT:
            if column not in known:
                self._db.execute(f"ALTER TABLE windows ADD COLUMN {column}")

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    def meta(self, key: str) -> Any:
        """Return what is stored under a key, None when nothing is."""
        found = self._read("SELECT value FROM meta WHERE key = ?", [key])
        return json.loads(found[0][0]) if found else None

    def set_meta(self, key: str, value: Any) -> None:
        """Store a plain value under a key."""
        with self._transaction():
            self._db.execute("REPLACE INTO meta VALUES (?, ?)", [key, json.dumps(value)])

    def plan(self, pieces: Iterable[Piece]) -> None:
        """Store what is to be read; a plan that was not completed starts again."""
        with self._transaction():
            self._db.execute("DELETE FROM pieces")
        batch: list[tuple[str]] = []
        for piece in pieces:
            batch.append((json.dumps(piece.plain()),))
            if len(batch) == TOGETHER:
                self._add(batch)
                batch.clear()
        self._add(batch)
        self.set_meta("planned", True)

    def tasks(self, most: int, after: int) -> list[Task]:
        """Return the next pieces that are not done, behind piece number ``after``."""
        found = self._read(
            "SELECT id, piece FROM pieces WHERE done = 0 AND id > ? ORDER BY id LIMIT ?",
            [after, most],
        )
        return [Task(number, Piece.of(json.loads(text))) for number, text in found]

    def store(self, answers: Sequence[tuple[int, Sequence[Row]]]) -> None:
        """Store the rows of pieces, by number, and that these are done."""
        values = ", ".join("?" * (2 + len(KEPT)))
        with self._transaction():
            for number, rows in answers:
                self._db.execute("UPDATE pieces SET done = 1 WHERE id = ?", [number])
                self._db.executemany(
                    f"REPLACE INTO windows VALUES ({values})",
                    [
                        [number, place, *(row[column] for column in KEPT)]
                        for place, row in enumerate(rows)
                    ],
                )

    def counts(self) -> Counts:
        """Count pieces and rows."""
        ((pieces, done),) = self._read("SELECT COUNT(*), SUM(done) FROM pieces")
        ((rows, errors),) = self._read("SELECT COUNT(*), COUNT(error) FROM windows")
        return Counts(pieces, done or 0, rows, errors)

    def pieces_without_rows(self) -> int:
        """Count the pieces that were read and gave no row: nothing of them was asked for."""
        query = (
            "SELECT COUNT(*) FROM pieces WHERE done AND NOT EXISTS "
            "(SELECT 1 FROM windows WHERE piece = id)"
        )
        ((found,),) = self._read(query)
        return int(found)

    def rank(self) -> None:
        """Give every loop its place; `ranked_rows` and `ranked_loops` need it."""
        with self._explained():
            for table in ("histories", "standing"):
                self._db.execute(f"DROP TABLE IF EXISTS temp.{table}")
            self._db.executescript(_HISTORIES + _APART)
            self._db.execute(_STANDING)
            self._db.execute("CREATE INDEX temp.standing_by_loop ON standing (history, loop)")

    def ranked_rows(self) -> Iterator[list[Any]]:
        """Yield all rows, best-ranked loop first, each loop in the order of time."""
        names = ", ".join(f"w.{column}" for column in COLUMNS)
        query = (
            f"SELECT {names} FROM windows AS w JOIN temp.histories AS h ON w.file = h.file "
            "JOIN temp.standing AS s ON h.history = s.history AND w.loop = s.loop "
            f"ORDER BY {_RANKED}, {_IN_TIME.format('')}"
        )
        with self._explained():
            for row in self._db.execute(query):
                yield list(row)

    def notes(self) -> Iterator[tuple[str, str, str]]:
        """Yield file, loop and how the file was read, where that is not plain."""
        query = (
            "SELECT DISTINCT file, loop, notes FROM windows WHERE notes IS NOT NULL "
            "ORDER BY file, loop"
        )
        with self._explained():
            yield from self._db.execute(query)

    def ranked_loops(self, most: int) -> list[Row]:
        """Return the first loops of the ranking with their counts."""
        return self._dicts(f"SELECT * FROM temp.standing AS s ORDER BY {_RANKED} LIMIT ?", [most])

    def classes(self) -> dict[int, int]:
        """Return how many loops are in each class of the ranking."""
        return dict(self._read("SELECT class, COUNT(*) FROM temp.standing GROUP BY class"))

    def windows_of(self, history: str, loop: str, most: int) -> list[Row]:
        """Return the last windows of a loop, oldest first."""
        rows = self._dicts(
            "SELECT w.* FROM temp.histories AS h JOIN windows AS w ON w.file = h.file "
            f"WHERE h.history = ? AND w.loop = ? ORDER BY {_IN_TIME.format('DESC')} LIMIT ?",
            [history, loop, most],
        )
        return rows[::-1]

    def errors(self, most: int) -> list[Row]:
        """Return the first rows with an error."""
        return self._dicts(
            "SELECT file, loop, start, error FROM windows WHERE error IS NOT NULL "
            "ORDER BY piece, number LIMIT ?",
            [most],
        )

    def index_loops(self) -> None:
        """Make `windows_of` quick; for a run that gets no more rows."""
        with self._transaction():
            self._db.execute("CREATE INDEX IF NOT EXISTS by_loop ON windows (file, loop)")

    def _add(self, batch: Sequence[tuple[str]]) -> None:
        with self._transaction():
            self._db.executemany("INSERT INTO pieces (piece) VALUES (?)", batch)

    def _dicts(self, query: str, parameters: Sequence[Any]) -> list[Row]:
        with self._explained():
            found = self._db.execute(query, parameters)
            names = [column[0] for column in found.description]
            return [dict(zip(names, row, strict=True)) for row in found]

    def _read(self, query: str, parameters: Sequence[Any] = ()) -> list[Any]:
        with self._explained():
            return self._db.execute(query, parameters).fetchall()

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with self._explained():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield
            except BaseException:
                # On a full disk SQLite has rolled back itself.
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            if "locked" in str(error):
                raise AssessError(
                    f"{self._file.parent} is in use by another run; wait for it, or name another "
                    "folder with --out"
                ) from error
            raise AssessError(
                f"{self._file} cannot be used ({error}); check the folder and the free "
                "space, or name another folder with --out"
            ) from error
