"""The table in a recording: which line is its header, which lines are none of its samples.

    table = read_recorded_table(Path("export.csv"), ())
    table.file.header, table.notes

Exports of historians and spreadsheets have titles above the header, units or descriptions below
it, and a line at the end that counts the rows. Such lines are left out, and a note names them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from fieldlink.site.binary_tables import read_binary_table
from fieldlink.site.column_names import guess_columns
from fieldlink.site.csv_file import CsvFile, CsvRow, fit_rows, is_comment, parse_rows, read_text
from fieldlink.site.errors import Problem, RecordingError
from fieldlink.site.long_columns import find_long_columns
from fieldlink.site.number_cells import is_bad_value

__all__ = ["RecordedTable", "holds_values", "is_moment", "read_recorded_table"]

_LOOKED_AT = 100
"""First lines from which the separator and the header are found: more than any title has."""
_AGREEING = 0.8
"""Share of these lines that hold a separator equally often; the others are titles."""
_ABOVE_DATA = 6
"""Lines directly above the samples of which one is the header."""
_BELOW_DATA = 5
"""Lines at the end that may hold text in place of samples."""
_NUMBER = re.compile(
    r"[-+\u2212]?[.,]?\d[\d.,'\u2019\u00a0\u202f ]*(e[-+]?\d+)?\s*%?", re.IGNORECASE
)
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(,\d+)?")
_MOMENT = re.compile(
    r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([T ,].*)?"
    r"|(\d+ days?,? )?\d{1,2}:\d{2}([:.,].*)?( ?[AaPp][Mm])?"
    r"|\d{1,2}[-/. ][A-Za-z]{3,9}\.?[-/. ]\d{2,4}([ ,].*)?"
)


@dataclass(frozen=True, slots=True)
class RecordedTable:
    """A recording's header and rows, and what a person should know of how they were found."""

    file: CsvFile
    notes: tuple[str, ...]


def read_recorded_table(path: Path, named: Sequence[str]) -> RecordedTable:
    """Read the table of a recording.

    Args:
        path: text with comma, semicolon, tab, bar or blanks between the cells of a row; a
            workbook, of which the first sheet is read; a Parquet or a MATLAB file.
        named: columns that the user has named; the header holds them.

    Raises:
        RecordingError: not readable, empty, or rows of another length than the header.
    """
    if path.suffix.lower() == ".toml":
        remedy = (
            "name a recording; fieldlink diagnose, report and assess take site files, assess also "
            "the description of an SQL table"
        )
        raise RecordingError([Problem(str(path), "", "is a TOML file, not a recording", remedy)])
    binary = read_binary_table(path)
    if binary is None:
        separator, text = _separated(read_text(path, RecordingError, pipe=True))
        rows = parse_rows(path, text, separator, RecordingError)
        if rows and holds_values(rows[0].cells):
            rows = [*_commented_header(text, separator, rows[0]), *rows]
    else:
        separator, rows = "\t", binary.rows
        while rows and not any(rows[-1].cells):
            rows.pop()
    if not rows:
        empty = Problem(str(path), "", "is empty", "give a header and rows of data")
        raise RecordingError([empty])
    header, begin = _find_header(rows, named)
    end = _last_sample(rows, begin, len(_trimmed(header)))
    file = fit_rows(path, separator, header, rows[begin:end], RecordingError)
    between = tuple(row for row in rows[:begin] if row.line > header.line)
    file = replace(file, under_header=between)
    left_out = [
        row.line
        for row in [*rows[:begin], *rows[end:]]
        if row.line != header.line and any(row.cells)
    ]
    notes = () if binary is None else binary.notes
    if left_out:
        lines = ", ".join(map(str, left_out))
        word = "line" if len(left_out) == 1 else "lines"
        notes += (f"the header is line {header.line}; {word} without samples: {lines}",)
    return RecordedTable(file, notes)


def holds_values(cells: Sequence[str]) -> bool:
    """Whether at least half of the filled cells hold a number or a moment."""
    filled = [cell for cell in cells if cell]
    values = sum(map(_is_value, filled))
    return 2 * values >= len(filled) > 0


def is_moment(cell: str) -> bool:
    """Whether a cell is written as a date or a time of day."""
    return _MOMENT.fullmatch(cell) is not None


def _is_value(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell) or is_moment(cell))


def _separated(text: str) -> tuple[str, str]:
    """Return the separator, and the text in which it stands between cells."""
    first, _, rest = text.partition("\n")
    if told := re.fullmatch(r'"?sep=(.)"?', first.strip(), re.IGNORECASE):
        return told[1], "\n" + rest
    lines = [
        line
        for line in text.split("\n", 3 * _LOOKED_AT)[: 3 * _LOOKED_AT]
        if line.strip() and not is_comment(line)
    ][:_LOOKED_AT]
    shares = {separator: _agreement([line.count(separator) for line in lines], 1)
              for separator in ";\t|,"}  # fmt: skip
    best = max(shares, key=lambda separator: shares[separator])
    words = [line.split() for line in lines]
    if _agreement([len(line) for line in words], 2) >= _AGREEING and (
        shares[best] == 0.0 or (best == "," and _are_decimal_commas(words))
    ):
        return "\t", "\n".join("\t".join(line.split()) for line in text.split("\n"))
    for separator, share in shares.items():
        if share >= _AGREEING:
            return separator, text
    return (best if shares[best] > 0.0 else ","), text


def _are_decimal_commas(lines: Sequence[Sequence[str]]) -> bool:
    """Whether the commas of lines that blanks separate stand within numbers: ``0 40,86 42,56``.

    Below ``time,op,pv`` they do not: there ``0,1 634,1 703`` has grouped digits.
    """
    numbers = [n for n, line in enumerate(lines) if all(map(_DECIMAL_COMMA.fullmatch, line))]
    if len(numbers) < _AGREEING * len(lines):
        return False
    first = numbers[0]
    commas = [" ".join(line).count(",") for line in lines[max(0, first - 1) : first + 1]]
    return len(commas) < 2 or commas[0] != commas[1]


def _commented_header(text: str, separator: str, first: CsvRow) -> list[CsvRow]:
    """The line above the first row, where it is a comment of as many cells: ``# time,op,pv``."""
    lines = text.split("\n", first.line)[: first.line - 1]
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines or not is_comment(lines[-1]):
        return []
    names = tuple(name.strip(' \t"') for name in lines[-1].strip(" \t#").split(separator))
    return [CsvRow(len(lines), names)] if len(names) == len(first.cells) else []


def _agreement(counts: Sequence[int], least: int) -> float:
    """Share of the lines that have the most frequent count of at least ``least``."""
    found = Counter(count for count in counts if count >= least)
    return max(found.values(), default=0) / max(1, len(counts))


def _find_header(rows: Sequence[CsvRow], named: Sequence[str]) -> tuple[CsvRow, int]:
    """Return the header and the index of the first sample."""
    for number, row in enumerate(rows[:_LOOKED_AT]):
        if find_long_columns(_trimmed(row)) is not None:
            return row, number + 1
    looked_at = [_trimmed(row) for row in rows[:_LOOKED_AT]]
    width = Counter(map(len, looked_at)).most_common(1)[0][0]
    is_bad = [any(cells) and all(map(is_bad_value, cells)) for cells in looked_at]
    is_sample = [
        len(row.cells) >= width and _is_sample(cells, width)
        for row, cells in zip(rows, looked_at, strict=False)
    ]
    begin = next((n for n in range(len(is_sample)) if all(is_sample[n : n + 2])), 0)
    above = [n for n in range(begin) if not is_bad[n]][-_ABOVE_DATA:]
    candidates = [
        row
        for row, cells in ((rows[n], looked_at[n]) for n in above)
        if 2 * sum(map(bool, cells)) >= width and (width == 1 or len(cells) > 1)
    ]
    if not candidates:
        return rows[0], 1
    # A tag above, the signal below: FC101 over OP is FC101.OP.
    joined = [
        CsvRow(below.line, tuple(map(_join, above.cells, below.cells)))
        for above, below in pairwise(candidates)
        if len(above.cells) == len(below.cells)
    ]
    best = max([*candidates, *joined], key=lambda row: _roles_in(row, named))
    while is_bad[begin - 1] and rows[begin - 1].line > best.line:
        # A record may begin with bad samples alone.
        begin -= 1
    return best, begin


def _is_sample(cells: Sequence[str], width: int) -> bool:
    """Whether cells, those at the end that are empty left out, are values or words for bad ones."""
    known = [cell for cell in cells if not is_bad_value(cell)]
    return holds_values(known) and (len(cells) == width or all(map(_is_value, known)))


def _join(above: str, below: str) -> str:
    return f"{above}.{below}" if above and below else above or below


def _roles_in(row: CsvRow, named: Sequence[str]) -> tuple[int, int]:
    """How many named columns and how many roles a header would have."""
    folded = [cell.lower() for cell in row.cells]
    known = sum(name.strip().lower() in folded for name in named)
    guess = guess_columns(row.cells, {})
    return known, 2 * len(guess.columns) + len(guess.ambiguous)


def _last_sample(rows: Sequence[CsvRow], begin: int, width: int) -> int:
    """The index behind the last sample: lines of text at the end do not count.

    Nor does a last line that ends too early: the file was copied while it was written.
    """
    end = len(rows)
    if end - 1 > begin and len(rows[end - 1].cells) < width <= len(rows[end - 2].cells):
        return end - 1
    while end > max(begin, len(rows) - _BELOW_DATA):
        filled = [cell for cell in rows[end - 1].cells if cell]
        if len(rows[begin].cells) == 1 or len(filled) != 1 or holds_values(filled):
            break
        end -= 1
    while begin < end < len(rows) and not any(rows[end - 1].cells):
        end -= 1
    return end


def _trimmed(row: CsvRow) -> tuple[str, ...]:
    cells = row.cells
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells
