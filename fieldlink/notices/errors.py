"""What can go wrong with notices."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["NoticeError"]


class NoticeError(FieldlinkError):
    """A receiver cannot be set up, or did not take a notice."""
