"""``[findings]``: how often the daemon asks why loops swing, and when a finding is over."""

from __future__ import annotations

from pydantic import Field

from fieldlink.site.base import Model
from fieldlink.site.device import Seconds

__all__ = ["FindingsTable"]


class FindingsTable(Model):
    """``[findings]``: why loops swing, diagnosed again and again by the daemon."""

    enabled: bool = True
    """Whether the daemon diagnoses the loops at all."""
    every: Seconds = 3600.0
    """Plant seconds between two diagnoses of all full windows."""
    confirm_after: int = Field(default=2, ge=1, le=100)
    """Diagnoses that must show the same cause before its finding is confirmed."""
    close_after: int = Field(default=3, ge=1, le=100)
    """Diagnoses in a row without the cause after which its finding is closed."""
