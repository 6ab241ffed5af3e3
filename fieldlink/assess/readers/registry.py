"""The reader of each kind of place."""

from __future__ import annotations

from fieldlink.assess.readers.base import Reader

__all__ = ["KINDS", "reader_of"]


def _files() -> Reader:
    from fieldlink.assess.readers.files import FileReader

    return FileReader()


def _historian() -> Reader:
    from fieldlink.assess.readers.historian_samples import HistorianReader

    return HistorianReader()


def _sql() -> Reader:
    from fieldlink.assess.readers.sql_tables import SqlReader

    return SqlReader()


KINDS = {"files": _files, "historian": _historian, "sql": _sql}
"""A new kind of place is one module and one line here."""


def reader_of(kind: str) -> Reader:
    """Return the reader of a kind of place."""
    return KINDS[kind]()
