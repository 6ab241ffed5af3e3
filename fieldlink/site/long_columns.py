"""The columns of a table with a row for each value, known by their headings.

find_long_columns(("Time", "Tag", "Value", "Quality"))  # LongColumns(time=0, tag=1, value=2, ...)
find_long_columns(("Time", "OP", "PV"))  # None
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from fieldlink.site.column_names import DATE_WORDS, SIGNAL_WORDS, UMLAUTS, guess_columns

__all__ = ["LongColumns", "find_long_columns"]

_TAG = frozenset(
    (
        "tag", "tagname", "tagpath", "point", "pointname", "variable", "variablename", "varname",
        "signal", "signalname", "name", "field", "item", "itemid",
    )
)  # fmt: skip
_VALUE = frozenset(
    (
        "value", "val", "wert", "valeur", "valor", "varvalue", "floatvalue", "numericvalue",
        "valuenumeric",
    )
)  # fmt: skip
_QUALITY = frozenset(
    (
        "quality", "qual", "qualitaet", "qualitydetail", "opcquality", "status", "state",
        "validity",
    )
)  # fmt: skip


class LongColumns(NamedTuple):
    """Numbers of the columns; ``dates`` are those that may go with times of day."""

    time: int
    tag: int
    value: int
    quality: int | None
    dates: tuple[int, ...]


def find_long_columns(header: Sequence[str]) -> LongColumns | None:
    """Return the columns of a table with a row for each value; None for another table."""
    words = [_word(heading) for heading in header]
    tag, value = _first(words, _TAG), _first(words, _VALUE)
    guess = guess_columns(header, {})
    if tag is None or value is None or {"op", "pv"} & (guess.columns.keys() | guess.ambiguous):
        return None
    # A heading that is a word for the time goes before one that has it beside others: Time_ms.
    whole = (_first(words, frozenset(group.split())) for group in SIGNAL_WORDS["time"])
    time = next((number for number in whole if number is not None), guess.columns.get("time"))
    if time is None:
        return None
    dates = tuple(n for n, word in enumerate(words) if word in DATE_WORDS and n != time)
    return LongColumns(time, tag, value, _first(words, _QUALITY), dates)


def _first(words: Sequence[str], known: frozenset[str]) -> int | None:
    return next((number for number, word in enumerate(words) if word in known), None)


def _word(heading: str) -> str:
    """A heading as one word, without what stands in brackets."""
    plain = re.sub(r"[\[(].*?[\])]", " ", heading).casefold().translate(UMLAUTS)
    return "".join(re.findall("[a-z0-9]+", plain))
