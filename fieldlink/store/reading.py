"""Reading a historian: one place opens it, closes it, and says why it cannot be read.

with reading(url) as connection:
    rows = connection.execute(query).all()
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import cause_of, is_away, open_for_reading, shown
from fieldlink.store.errors import StoreAwayError, StoreError

__all__ = ["reading", "reading_error"]

_ADVICE = {
    "locked": "another program holds it: close that, or try again",
    "disk I/O error": "check the disk and its free space",
    "malformed": "it is damaged: a daemon that starts on it sets it aside and begins a new one, "
    "and sqlite3's .recover saves what can be read",
    "no such table": "check that it is a Fieldlink historian; if an earlier release wrote it, "
    "start the daemon on it once (fieldlink run), which adds what is missing",
}
"""What to do, by what the database said."""


@contextmanager
def reading(url: str) -> Iterator[Connection]:
    """Give a connection to a historian that exists.

    Raises:
        StoreError: it cannot be opened, or not be read while the block runs.
    """
    engine = open_for_reading(url)
    try:
        with engine.connect() as connection:
            yield connection
    except SQLAlchemyError as error:
        raise reading_error(engine, url, error) from error
    finally:
        engine.dispose()


def reading_error(engine: Engine, url: str, error: SQLAlchemyError) -> StoreError:
    """Return what to raise for a historian that cannot be read.

    Args:
        engine: on it.
        url: its address, for the message.
        error: what the database said.

    Returns:
        A `StoreAwayError` where its server does not answer.
    """
    what, cause = f"the historian {shown(url)} cannot be read", cause_of(error)
    if is_away(engine, error):
        return StoreAwayError(f"{what}: {cause}; check that its server runs")
    advice = (told for words, told in _ADVICE.items() if words in cause)
    return StoreError(f"{what}: {cause}; {next(advice, 'check that it is a Fieldlink historian')}")
