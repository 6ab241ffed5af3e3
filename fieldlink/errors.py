"""The root of every error that a configuration, a file, a device or a disk can cause."""

from __future__ import annotations

__all__ = ["FieldlinkError"]


class FieldlinkError(Exception):
    """Something outside the program is wrong; the message names the place and the remedy."""
