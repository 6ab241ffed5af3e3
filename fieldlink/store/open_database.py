"""The database that is being written: opened, replaced when damaged, found again when gone."""

from __future__ import annotations

import structlog
from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.damage import set_aside
from fieldlink.store.database import cause_of, file_of, open_for_writing
from fieldlink.store.errors import StoreCorruptError, StoreError
from fieldlink.store.file_presence import Presence
from fieldlink.store.foreign_log import set_foreign_log_aside
from fieldlink.store.record_queue import RecordQueue, now_ms
from fieldlink.store.records import EventRecord
from fieldlink.store.running_counts import RunningCounts
from fieldlink.store.wal import keep_damaged_log
from fieldlink.store.writers import Claim

__all__ = ["OpenDatabase"]

_log = structlog.get_logger(__name__)


class OpenDatabase:
    """Keeps an engine to write with.

    Args:
        url: SQLAlchemy address.
        busy_timeout: seconds one attempt waits for another program's lock.
        records: takes the events of what happened to the file.
        counts: of the historian.

    Attributes:
        claim: the right to write, for every file that is opened; None for who needs none.
    """

    def __init__(
        self, url: str, busy_timeout: float, records: RecordQueue, counts: RunningCounts
    ) -> None:
        self._url = url
        self._busy_timeout = busy_timeout
        self._records = records
        self._counts = counts
        self._presence: Presence | None = None
        self.claim: Claim | None = None
        self._engine: Engine | None = None

    @property
    def engine(self) -> Engine:
        """The engine to write with."""
        assert self._engine is not None
        return self._engine

    def open(self, opened: EventRecord) -> None:
        """Open the database and store ``opened`` in it; a damaged file is set aside for a new one.

        Raises:
            StoreError: see `open_for_writing`.
        """
        try:
            self._engine = self._open(opened)
        except StoreCorruptError as error:
            self._engine = self._start_new_file(str(error.__cause__), opened)
        self._counts.add(written=1)

    def close(self) -> None:
        """Give the claim back and close it."""
        try:
            if self.claim is not None:
                with self.engine.begin() as connection:
                    self.claim.release(connection)
        except SQLAlchemyError as error:
            # It runs out by itself.
            _log.warning("store.claim_left", error=cause_of(error))
        finally:
            self.engine.dispose()

    def is_lost(self) -> bool:
        """Whether the file under the database's name is no longer the one that is open."""
        return self._presence is not None and bool(self._presence.lost())

    def find_again(self) -> None:
        """Open what is there under the file's name now, or begin a new file.

        Raises:
            StoreError: neither can be done now.
        """
        presence = self._presence
        assert presence is not None
        what = presence.lost()
        presence.let_go(self.engine)
        file = file_of(self._url)
        message = (
            f"{file} {what} while it was written; what was in it is where it is now, and the "
            "historian goes on here"
        )
        opened = EventRecord(now_ms(), "store.gone", "store", message)
        self.open(opened)
        self._counts.add(gone=1)
        _log.error("store.gone", file=str(file), what=what)

    def replace(self, cause: str) -> bool:
        """Go on with a new file in place of a damaged one; False when that cannot be done now."""
        self.engine.dispose()
        opened = EventRecord(now_ms(), "store.reopened", "store", "after damage")
        try:
            self._engine = self._start_new_file(cause, opened)
        except StoreError as problem:
            self._counts.mention(str(problem))
            _log.error("store.cannot_be_replaced", error=str(problem))
            return False
        return True

    def _open(self, opened: EventRecord) -> Engine:
        file = file_of(self._url)
        left = "" if file is None else set_foreign_log_aside(file)
        damage = "" if file is None else keep_damaged_log(file)
        engine = open_for_writing(self._url, opened, self._busy_timeout, self.claim)
        self._presence = None if file is None else Presence(file)
        if left:
            _log.warning("store.log_left", message=left)
            self._records.put(EventRecord(now_ms(), "store.log_left", "store", left))
        if damage:
            _log.error("store.log_damaged", error=damage)
            self._records.put(EventRecord(now_ms(), "store.log_damaged", "store", damage))
        return engine

    def _start_new_file(self, cause: str, opened: EventRecord) -> Engine:
        file = file_of(self._url)
        assert file is not None
        aside = set_aside(file)
        message = (
            f"{file.name} is damaged ({cause}) and was set aside as {aside.name}; a new historian "
            "has begun. sqlite3's .recover may save what is in the old one"
        )
        engine = self._open(opened)
        self._counts.add(set_aside=1)
        self._counts.mention(cause)
        _log.error("store.set_aside", file=str(file), aside=str(aside), cause=cause)
        self._records.put(EventRecord(now_ms(), "store.set_aside", "store", message))
        return engine
