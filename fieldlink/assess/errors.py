"""What can be wrong with an assessment as a whole; what is wrong with one loop is its row."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["AssessError", "PlaceAwayError", "ReadingError"]


class AssessError(FieldlinkError):
    """The assessment cannot begin or cannot go on; the message names the place and the remedy."""


class ReadingError(FieldlinkError):
    """The samples of a place cannot be read; the message becomes the row's error."""


class PlaceAwayError(ReadingError):
    """A whole place is out of reach, such as a database server or a network folder: no row's."""
