"""What is wrong with a rehearsal, apart from its outcome."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["ScenarioError"]


class ScenarioError(FieldlinkError):
    """A scenario that cannot be run."""
