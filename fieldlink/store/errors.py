"""What the store cannot do."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = [
    "StoreAddressError",
    "StoreAwayError",
    "StoreCorruptError",
    "StoreError",
    "StoreInUseError",
    "StoreMismatchError",
]


class StoreError(FieldlinkError):
    """The historian cannot be opened, read or written; the message names place and remedy."""


class StoreAwayError(StoreError):
    """The database server does not answer, or ended the connection; trying again may help."""


class StoreAddressError(StoreError):
    """The address is wrong, or there is no driver for it."""

    may_pass = False


class StoreMismatchError(StoreError):
    """The database is not a historian of this release; trying again does not change that."""

    may_pass = False


class StoreCorruptError(StoreError):
    """The file was a historian and is damaged: what is in it cannot be trusted as a whole."""


class StoreInUseError(StoreError):
    """Another daemon writes one of our loops.

    Args:
        message: who, where and since when.
        alive: whether it was seen to write; otherwise it may have ended without a word.
    """

    def __init__(self, message: str, *, alive: bool) -> None:
        super().__init__(message)
        self.alive = alive
