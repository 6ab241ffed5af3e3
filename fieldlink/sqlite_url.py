"""The address of an SQLite file, as SQLAlchemy and the site file write it."""

from __future__ import annotations

from pathlib import Path

__all__ = ["SQLITE", "sqlite_url"]

SQLITE = "sqlite:///"


def sqlite_url(path: str | Path) -> str:
    """Return the address of a file, or of a folder to be continued by ``/NAME``.

    ``?`` begins options in an address, and ``%`` a character's number.
    """
    text = str(path)
    if "%" not in text and "?" not in text:
        return f"{SQLITE}{text}"
    from sqlalchemy.engine import URL

    return URL.create("sqlite", database=text).render_as_string()
