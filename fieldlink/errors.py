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


class MissingExtraError(FieldlinkError):
    """What the site file asks for needs a package that is not installed.

    Args:
        place: what needs it: the file and its table.
        packages: that are missing.
        extra: of Fieldlink, that brings them.
    """

    may_pass = False

    def __init__(self, place: str, packages: str, extra: str) -> None:
        super().__init__(
            f"{place} needs {packages}; pip install 'fieldlink[{extra}]', or remove the table"
        )
