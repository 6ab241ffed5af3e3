"""What the store cannot do."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["StoreError"]


class StoreError(FieldlinkError):
    """The historian cannot be opened, read or written; the message names place and remedy."""
