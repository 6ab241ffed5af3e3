"""CSV files as people have them: any of three separators, any line ends, with or without a BOM."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fieldlink.errors import FieldlinkError
from fieldlink.site.bounded_file import UnreadableFileError, read_bytes
from fieldlink.site.errors import Problem
from fieldlink.site.number_cells import find_decimal_mark, may_group, plain_number

__all__ = ["CsvFile", "CsvRow", "fit_rows", "is_comment", "parse_rows", "read_csv", "read_text"]

_MAX_PROBLEMS = 20

_COMMENT = re.compile(
    r"^[^\S\n]*#(?!(?:N/A|N/D|NV|#+(?=[;,\t|])|[A-Z\u00a1\u00c0-\u00dd/0]+[!?])[^\S\n]*(?:[;,\t|]|$))",
    re.MULTILINE,
)
"""A line that begins with ``#``, unless its first cell is an error of a spreadsheet (``#N/A``,
``#DIV/0!``, ``#WERT!``, a number too wide for its column): that is a bad sample."""
_BLANK = re.compile(r"[^\S\n]|\"")
"""White space but for ends of lines; and quotes, whose cells may hold ends of lines."""

_PACKED = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"7z\xbc\xaf": "7z",
}
"""How files begin that other programs have packed."""

_MARKED_UP = re.compile(r"\s*<(?:\?xml|!doctype|html|head|meta|table)\b", re.IGNORECASE)
"""How reports begin that web pages of historians and laboratory systems call ``.xls``."""

LARGEST = 1000
"""Megabytes: eight months of a loop at a sample a second, a hundred of the largest maps."""


@dataclass(frozen=True, slots=True)
class CsvRow:
    """One row: its line in the file, and its cells without surrounding blanks."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CsvFile:
    """A table of text, as many cells in every row as columns in the header.

    Attributes:
        path: the file.
        separator: between the cells.
        header: the columns' names.
        header_line: 1-based line of the header.
        rows: below the header.
        under_header: rows between the header and the first sample, such as units.
    """

    path: Path
    separator: str
    header: tuple[str, ...]
    header_line: int
    rows: tuple[CsvRow, ...]
    under_header: tuple[CsvRow, ...] = ()
    _marks: dict[int, str | None] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def decimal_mark(self, column: int) -> str | None:
        """Return the mark that begins decimals in a column, None where no cell tells.

        It is found once: every loop of a table with hundreds asks for all columns.
        """
        if column not in self._marks:
            self._marks[column] = find_decimal_mark(row.cells[column] for row in self.rows)
        return self._marks[column]

    def number(self, cell: str) -> float:
        """Return a cell's number; a decimal comma counts when the separator is not the comma.

        Raises:
            ValueError: the cell holds no finite number, or its comma may group digits.
        """
        text = cell
        if self.separator != "," and "," in cell and "." not in cell:
            if may_group(cell):
                raise ValueError(cell)
            text = cell.replace(",", ".", 1)
        return plain_number(text)


def read_csv(
    path: Path, error: Callable[[Iterable[Problem]], FieldlinkError], *, pipe: bool = False
) -> CsvFile:
    """Read a CSV file; blank lines at its end and lines that begin with ``#`` are skipped.

    Args:
        path: the file.
        error: makes the error to raise.
        pipe: whether the file may be a pipe, which is waited for.

    Raises:
        FieldlinkError: made by ``error`` of everything that is wrong: not readable, not text, no
            header, rows of another length.
    """
    lines = read_text(path, error, pipe=pipe)
    separator = _separator(lines)
    rows = parse_rows(path, lines, separator, error)
    if not rows:
        raise error([Problem(str(path), "", "is empty", "give a header and rows of data")])
    header, *body = rows
    return fit_rows(path, separator, header, body, error)


def fit_rows(
    path: Path,
    separator: str,
    header: CsvRow,
    body: Sequence[CsvRow],
    error: Callable[[Iterable[Problem]], FieldlinkError],
) -> CsvFile:
    """Return the table of a header and its rows; empty cells at their ends do not count.

    Raises:
        FieldlinkError: made by ``error``: rows that are longer or shorter than the header.
    """
    columns = list(header.cells)
    while columns and not columns[-1]:
        columns.pop()
    fitted, problems = [], []
    for row in body:
        cells = row.cells
        while len(cells) > len(columns) and not cells[-1]:
            cells = cells[:-1]
        if len(cells) == len(columns):
            fitted.append(row if cells is row.cells else CsvRow(row.line, cells))
        elif not any(cells):
            fitted.append(CsvRow(row.line, ("",) * len(columns)))
        else:
            message = f"{_cells(len(cells))} where the header has {len(columns)}"
            remedy = "complete the row, and quote cells that hold the separator"
            problems.append(Problem(str(path), "", message, remedy, row.line))
    lengths = Counter(len(row.cells) for row in body)
    length, rows = lengths.most_common(1)[0] if lengths else (len(columns), 0)
    if len(problems) > _MAX_PROBLEMS and length != len(columns) and 2 * rows > len(body):
        message = f"{_cells(length)} where the header has {len(columns)}, as in {rows} rows"
        remedy = "quote cells that hold the separator"
        if separator == ",":
            remedy += "; with decimal commas, separate the cells by semicolons"
        problems = [replace(problems[0], message=message, remedy=remedy)]
    if problems:
        more = len(problems) - _MAX_PROBLEMS
        if more > 0:
            message, remedy = f"{more} more rows are wrong", "is the separator the right one?"
            problems[_MAX_PROBLEMS:] = [Problem(str(path), "", message, remedy, problems[-1].line)]
        raise error(problems)
    return CsvFile(path, separator, tuple(columns), header.line, tuple(fitted))


def _cells(count: int) -> str:
    return "1 cell" if count == 1 else f"{count} cells"


def read_text(
    path: Path, error: Callable[[Iterable[Problem]], FieldlinkError], *, pipe: bool
) -> str:
    """Return the text of a file with line ends ``\\n``.

    Raises:
        FieldlinkError: made by ``error``: not readable, or no text.
    """
    try:
        raw = read_bytes(path, most_megabytes=LARGEST, pipe=pipe)
    except UnreadableFileError as cause:
        raise error([Problem(str(path), "", cause.message, cause.remedy)]) from cause
    packed = next((name for begin, name in _PACKED.items() if raw.startswith(begin)), None)
    if packed is not None:
        raise error([Problem(str(path), "", f"is packed ({packed})", "unpack it first")])
    if raw[:4] in (b"\xff\xfe\0\0", b"\0\0\xfe\xff"):
        raise error([_not_csv(path, "it is UTF-32 text")])
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings = ["utf-16"]
    elif raw[1:100:2].count(0) > 40 or raw[0:100:2].count(0) > 40:
        # Which byte of each character is zero tells the order.
        encodings = ["utf-16-le" if raw[1:100:2].count(0) > raw[0:100:2].count(0) else "utf-16-be"]
    elif b"\0" in raw or raw[:2] == b"PK":
        raise error([_not_csv(path, "it is a binary file")])
    else:
        # What spreadsheets write where UTF-8 is not the default.
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" in text:
            raise error([_not_csv(path, "it is a binary file")])
        if _MARKED_UP.match(text):
            remedy = "open it in a spreadsheet and save it as CSV or .xlsx"
            raise error([Problem(str(path), "", "is HTML or XML text, whatever its name", remedy)])
        return text.replace("\r\n", "\n").replace("\r", "\n")
    message = "is text in another encoding than UTF-8, UTF-16 and Windows-1252"
    remedy = 'save it as UTF-8 (spreadsheets call that "CSV UTF-8")'
    raise error([Problem(str(path), "", message, remedy)])


def is_comment(line: str) -> bool:
    """Whether a line is a comment: it begins with ``#`` and not with an error of a spreadsheet."""
    return _COMMENT.match(line) is not None


def _not_csv(path: Path, why: str) -> Problem:
    return Problem(str(path), "", f"is not a CSV file: {why}", "export it as CSV with a header row")


def _separator(text: str) -> str:
    """Return the separator that the header uses most."""
    for line in text.split("\n"):
        if line.strip() and not is_comment(line):
            return max(";\t,", key=line.count)
    return ","


def parse_rows(
    path: Path,
    text: str,
    separator: str,
    error: Callable[[Iterable[Problem]], FieldlinkError],
) -> list[CsvRow]:
    """Return the rows of a text, without comments and without blank lines at its ends.

    Raises:
        FieldlinkError: made by ``error``: quotes that do not close.
    """
    try:
        rows = _parse(text, separator)
    except csv.Error as cause:
        raise error([_not_csv(path, str(cause))]) from cause
    while rows and not any(rows[-1].cells):
        rows.pop()
    return rows


_QUOTES = {"unexpected end of data": "a quote begins there that is never closed"}
"""What the csv module says of quotes, in words."""


def _parse(text: str, separator: str) -> list[CsvRow]:
    comments: frozenset[int] = frozenset()
    # A large file without comments is not taken apart a second time.
    if _COMMENT.search(text):
        lines = text.split("\n")
        comments = frozenset(n for n, line in enumerate(lines, 1) if is_comment(line))
        text = "\n".join("" if n in comments else line for n, line in enumerate(lines, 1))
    reader = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    # a long record of numbers has no blanks: then no cell is looked through for them
    is_padded = _BLANK.search(text) is not None
    rows: list[CsvRow] = []
    last_line = 0
    while True:
        try:
            cells = next(reader)
        except StopIteration:
            return rows
        except csv.Error as error:
            raise csv.Error(f"line {last_line + 1}: {_QUOTES.get(str(error), error)}") from error
        first_line, last_line = last_line + 1, reader.line_num
        if first_line in comments or (not rows and not any(cells)):
            continue
        rows.append(CsvRow(first_line, tuple(map(str.strip, cells) if is_padded else cells)))
