"""What the store cannot do."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["StoreCorruptError", "StoreError", "StoreMismatchError"]


class StoreError(FieldlinkError):
    """The historian cannot be opened, read or written; the message names place and remedy."""


class StoreMismatchError(StoreError):
    """The database is not a historian of this release; trying again does not change that."""


class StoreCorruptError(StoreError):
    """The file was a historian and is damaged: what is in it cannot be trusted as a whole."""
