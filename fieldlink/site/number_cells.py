"""A column of text as numbers: decimal comma or point, grouped digits, a unit, bad values.

    parse_numbers(["1.234,5 %", "998,0 %", "I/O Timeout"], comma_separates=False).values
    # [1234.5, 998.0, nan]

The notation is that of the whole column: a single cell such as ``1.234`` does not tell whether its
point is a decimal point. Where the column does not tell either, the other columns of the file do.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BAD",
    "NumberCells",
    "find_decimal_mark",
    "is_bad_value",
    "may_group",
    "parse_numbers",
    "plain_number",
]

BAD = frozenset({"", "nan", "null", "na", "n/a", "none"})
"""Cells without a value, in any case."""

_BAD_STATES = frozenset(
    (
        "-", "--", "---", "----", "?", "??", "???", "????", "*", "**", "***", "****",
        "inf", "+inf", "-inf", "infinity", "-infinity", "-nan", "nan(ind)", "-nan(ind)",
        "1.#inf", "-1.#inf", "1.#qnan", "1.#ind", "-1.#ind",
        "bad", "bad value", "bad quality", "bad input", "bad data", "missing", "invalid",
        "no data", "nodata", "no value", "no sample", "no result", "no good data",
        "not available", "i/o timeout", "io timeout", "timeout", "time out",
        "comm fail", "comm. fail", "comm error", "error", "err", "fail", "failed",
        "calc failed", "calc timeout", "under range", "over range", "underrange", "overrange",
        "out of range", "out of serv", "out of service", "scan off", "scan timeout", "off scan",
        "shutdown", "intf shut", "configure", "unit down", "pt created", "arc off-line",
        "archive offline", "doubtful", "not connected", "equip fail", "sensor failure",
        "device failure", "uncertain", "unknown", "stale", "disconnected", "inp outrange",
        "n.a.", "undefined", "(null)", "<null>", "\\n", "fehler", "ung\u00fcltig", "schlecht",
    )
)  # fmt: skip
"""What historians (PI's digital states, OPC's qualities) and spreadsheets write for a bad value."""

_PI_ERROR = re.compile(r"\[-\d+\] [A-Za-z]")
"""What PI DataLink writes instead of a value: [-11059] No Good Data For Calculation."""

NO_VALUE_FROM = 3.4e38
"""From this magnitude on a number marks a sample without a value: the largest number of a
transmitter's float (IEEE 754 binary32: 3.4028235e38), however few digits are written of it, and
whatever exceeds it, such as the largest double (1.8e308)."""

_CELL = re.compile(
    r"([-+]?[.,]?\d(?:[\d.,' ]*\d)?[.,]?(?:[de][-+]?\d+)?)\s*([%\u00b0\u00b5a-z].*)?", re.IGNORECASE
)
_GROUPED = re.compile(r"[-+]?\d{1,3}([.,' ]\d{3})+([.,]\d*)?([de][-+]?\d+)?", re.IGNORECASE)
_THREE_BEHIND = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")
"""A mark that may group digits or begin decimals."""
_FORTRAN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)d[-+]?\d+", re.IGNORECASE)
"""A number in Fortran's notation of double precision, 1.203860D+03."""
_EXPONENT = str.maketrans("dD", "ee")
_OTHER = {".": ",", ",": "."}
_PLAIN = str.maketrans(
    {"\u2212": "-", "\u2019": "'", "\u00b4": "'", "\u00a0": " ", "\u202f": " ", "\u2009": " "}
)


@dataclass(frozen=True, slots=True, eq=False)
class NumberCells:
    """A column as numbers.

    Attributes:
        values: shape ``(n,)``, NaN where a cell holds no number.
        bad_words: words that stand for bad values, with their number.
        wrong: index of the first cell of each text that is neither, with the number of such cells.
        ambiguous: a cell whose mark may group digits or begin decimals; None where none is.
        unit: text behind most of the numbers.
    """

    values: NDArray[np.float64]
    bad_words: Mapping[str, int]
    wrong: Mapping[int, int]
    ambiguous: str | None
    unit: str = ""


@dataclass(frozen=True, slots=True)
class _Notation:
    decimal: str = "."
    grouping: str = ""
    unit: str = ""

    def number(self, text: str) -> float:
        """Raises ValueError where a text is written in another way."""
        if self.unit and text.endswith(self.unit):
            text = text[: -len(self.unit)].rstrip()
        for mark in (self.grouping, "'", " "):
            if mark and mark in text:
                if not _GROUPED.fullmatch(text):
                    raise ValueError(text)
                text = text.replace(mark, "")
        if self.decimal != ".":
            if "." in text:
                raise ValueError(text)
            text = text.replace(self.decimal, ".")
        return plain_number(text)


def is_bad_value(cell: str) -> bool:
    """Whether a cell is a word that historians and spreadsheets write for a bad value, or empty."""
    folded = cell.casefold()
    return (
        folded in BAD
        or folded in _BAD_STATES
        or cell.startswith("#")
        or _PI_ERROR.match(cell) is not None
    )


def find_decimal_mark(cells: Iterable[str]) -> str | None:
    """Return the mark, point or comma, that begins decimals in a column; None if no cell tells."""
    for cell in cells:
        if "." not in cell and "," not in cell:
            continue
        found = _CELL.fullmatch(cell.translate(_PLAIN))
        if found is None:
            continue
        head = found[1]
        mark = max(".,", key=head.rfind)
        if head.count(mark) > 1:
            # Only groups repeat their mark.
            if _GROUPED.fullmatch(head):
                return _OTHER[mark]
        elif _OTHER[mark] in head or not _THREE_BEHIND.fullmatch(head):
            return mark
    return None


def may_group(text: str) -> bool:
    """Whether a number's only mark may group digits or begin decimals, as in ``1,234``."""
    return _THREE_BEHIND.fullmatch(text) is not None


def parse_numbers(
    cells: Sequence[str],
    *,
    comma_separates: bool,
    proven: Callable[[], str | None] = lambda: None,
) -> NumberCells:
    """Return a column's numbers.

    Args:
        cells: the text of each cell, without blanks around it.
        comma_separates: whether the comma separates the cells of the file; otherwise a comma alone
            begins decimals.
        proven: gives the decimal mark that the other columns of the file prove, if they do; called
            where this column's cells do not tell.
    """
    values = np.full(len(cells), np.nan)
    bad: Counter[str] = Counter()
    others: dict[int, str] = {}
    for index, cell in enumerate(cells):
        try:
            values[index] = plain_number(cell)
        except ValueError:
            if cell.casefold() in BAD:
                continue
            if is_bad_value(cell):
                bad[cell] += 1
            else:
                others[index] = cell.translate(_PLAIN)
    plain = [cells[index] for index in np.flatnonzero(~np.isnan(values)).tolist()]
    notation, ambiguous = _notation_of(plain, others, proven, comma_separates=comma_separates)
    if ambiguous is not None:
        return NumberCells(values, bad, {}, ambiguous)
    if notation.decimal != ".":
        # What looked like a plain number may have grouped digits: it is read again.
        dotted = {i: c for i, c in enumerate(cells) if "." in c and not np.isnan(values[i])}
        others = dotted | others
    first: dict[str, int] = {}
    wrong: Counter[int] = Counter()
    for index, text in others.items():
        try:
            values[index] = notation.number(text)
        except ValueError:
            values[index] = np.nan
            wrong[first.setdefault(text, index)] += 1
    _take_out_what_is_no_value(values, cells, bad)
    return NumberCells(values, bad, wrong, None, notation.unit)


def _take_out_what_is_no_value(
    values: NDArray[np.float64], cells: Sequence[str], bad: Counter[str]
) -> None:
    for index in np.flatnonzero(np.abs(values) >= NO_VALUE_FROM).tolist():
        values[index] = np.nan
        bad[cells[index]] += 1


def plain_number(text: str) -> float:
    """Return a finite number with a decimal point.

    Raises:
        ValueError: the text is none.
    """
    # Python reads 1_000 as a number; measured data does not write numbers so.
    if "_" in text:
        raise ValueError(text)
    try:
        value = float(text)
    except ValueError:
        if not _FORTRAN.fullmatch(text):
            raise
        value = float(text.translate(_EXPONENT))
    if value - value != 0.0:
        raise ValueError(text)
    return value


def _notation_of(
    plain: Sequence[str],
    others: Mapping[int, str],
    proven: Callable[[], str | None],
    *,
    comma_separates: bool,
) -> tuple[_Notation, str | None]:
    """The notation of a column, or a cell that is ambiguous; ``others`` are not plain numbers."""
    mark = find_decimal_mark(others.values()) or find_decimal_mark(plain)
    if not others and (mark is not None or not any("." in cell for cell in plain)):
        return _Notation(), None
    parts = [found for text in others.values() if (found := _CELL.fullmatch(text))]
    units = {found[2] or "" for found in parts}
    # One odd cell is a mistake, a text behind most numbers is their unit.
    unit = units.pop() if len(units) == 1 and 2 * len(parts) > len(plain) + len(others) else ""
    heads = [*plain, *(found[1] for found in parts)]
    if mark is not None:
        other = _OTHER[mark]
        against = next((head for head in heads if other in head and may_group(head)), None)
        if against is not None and any(
            mark in head or head.count(other) > 1 for head in heads if other in head
        ):
            # Other cells show that digits are grouped.
            against = None
        return _Notation(mark, other, unit), against
    undecided = [head for head in heads if may_group(head)]
    if not undecided:
        return _Notation(unit=unit), None
    marks = {"," if "," in head else "." for head in undecided}
    if len(marks) > 1:
        return _Notation(), undecided[0]
    mark = proven()
    if mark is not None:
        return _Notation(mark, _OTHER[mark], unit), None
    mark = marks.pop()
    if comma_separates:
        is_open = mark == ","
    else:
        # Decimals are printed with the same number of digits in every row: 992 before 1.005 has
        # digits in groups, or it is a mistake.
        is_open = any(re.fullmatch(r"[-+]?\d+", head) for head in heads)
    return _Notation(mark, "", unit), undecided[0] if is_open else None
