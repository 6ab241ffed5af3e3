"""The root of every error that a configuration, a file, a device or a disk can cause."""

from __future__ import annotations

from typing import ClassVar

__all__ = ["FieldlinkError"]


class FieldlinkError(Exception):
    """Something outside the program is wrong; the message names the place and the remedy.

    Attributes:
        may_pass: whether it may be over at the next start of a daemon, with nothing changed by
            hand: a full disk, a server that is not up yet. Only what surely stays says no.
    """

    may_pass: ClassVar[bool] = True
