"""What can go wrong with a report."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["ReportError"]


class ReportError(FieldlinkError):
    """A report cannot be made or written."""
