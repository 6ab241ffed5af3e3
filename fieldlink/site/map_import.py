"""Vendors' register lists, CSV or Excel, to register maps; every bad row is reported.

    found = import_map(Path("vendor.xlsx"))
    found.tags, found.problems, found.notes

Headings and cells are understood in the words of `map_words`, addresses as in `map_addresses`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from fieldlink.registers import DataType, Order, Tag
from fieldlink.site.csv_file import fit_rows, is_comment, parse_rows, read_csv, read_text
from fieldlink.site.errors import Problem, SiteError, nearest
from fieldlink.site.map_addresses import AddressStyle, guess_style, parse_address
from fieldlink.site.map_row import REQUIRED, RowReader
from fieldlink.site.map_scaling import LIST_COLUMNS, limits, scale_cell
from fieldlink.site.map_words import column_of, meaning_of, says_hexadecimal
from fieldlink.site.number_cells import may_group
from fieldlink.site.register_map import COLUMNS, collect_tags
from fieldlink.site.workbooks import explained_workbook
from fieldlink.spreadsheet import from_cell

__all__ = ["ImportedMap", "import_map"]

_HEADER_WITHIN = 30
_NUMBERS = [item.value for item in DataType if item.is_number]
_ROWS_OF_PLACES = 3
"""Rows from which numbers that only grow are places: two offsets may well be in order."""
_PLACE = re.compile(r"\d+(?:[.,]\d)?")
_LONG_TEXT = re.compile(r"(?:string|char|ascii|text)\s*[\[(]?(\d{1,9})[\])]?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ImportedMap:
    """What a list holds.

    Attributes:
        tags: the tags of the good rows, by name.
        problems: what is wrong, row by row.
        notes: how the list was understood, for a person to agree or not.
        rows: how many rows there were.
    """

    tags: Mapping[str, Tag]
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]
    rows: int

    @property
    def bad_rows(self) -> int:
        """How many rows have a problem."""
        return len({problem.line for problem in self.problems})


@dataclass(frozen=True, slots=True)
class _Sheet:
    """A list as text: heading cells, and (line, cells) of each row."""

    header: tuple[str, ...]
    header_line: int
    rows: tuple[tuple[int, tuple[str, ...]], ...]


def import_map(
    path: Path,
    *,
    addresses: AddressStyle | None = None,
    sheet: str | None = None,
    headings: Mapping[str, str] | None = None,
    word_order: Order = "big",
    byte_order: Order = "big",
) -> ImportedMap:
    """Read a vendor's list.

    Args:
        path: a CSV file, or an Excel workbook (.xlsx, .xlsm).
        addresses: how addresses are written; found out unless given.
        sheet: name of the workbook's sheet; the first unless given.
        headings: register map's column to the list's heading, where the list has words of its own.
        word_order, byte_order: of rows without an order of their own.

    Raises:
        SiteError: the file cannot be read, or names no columns that a register map needs.
    """
    workbook = path.suffix.lower() in (".xlsx", ".xlsm")
    named = headings or {}
    table = _read_workbook(path, sheet, named) if workbook else _read_text(path, named)
    columns, notes = _columns(path, table, named)
    texts = [cells[columns["address"]] for _, cells in table.rows]
    heading = table.header[columns["address"]]
    of_numbers = [
        cells[columns["address"]]
        for _, cells in table.rows
        if meaning_of("type", cells[columns["type"]]) in _NUMBERS
    ]
    guessed: AddressStyle = "hex" if says_hexadecimal(heading) else guess_style(texts, of_numbers)
    style = addresses or guessed
    notes.append(_about(style, guessed=addresses is None))
    rows: list[tuple[int, RowReader]] = []
    early: list[Problem] = []
    for line, cells in table.rows:
        values = {name: cells[number] for name, number in columns.items()}
        problem = _translate(path, line, values, style)
        if problem is not None:
            early.append(problem)
        else:
            rows.append((line, RowReader(str(path), line, _cells(values), _number)))
    tags, problems = collect_tags(str(path), rows, word_order, byte_order)
    notes += _about_scales(table, columns, tags)
    found = sorted((*early, *problems), key=lambda problem: problem.line or 0)
    return ImportedMap(tags, tuple(found), tuple(notes), len(table.rows))


def _read_text(path: Path, headings: Mapping[str, str]) -> _Sheet:
    text = read_text(path, SiteError, pipe=False)
    separator = _separator_of_header(text, headings)
    if separator is None:
        file = read_csv(path, SiteError)
    else:
        lines = parse_rows(path, text, separator, SiteError)
        at = next(n for n, row in enumerate(lines) if _is_header(row.cells, headings))
        file = fit_rows(path, separator, lines[at], lines[at + 1 :], SiteError)
    rows = tuple(
        (row.line, tuple(map(from_cell, row.cells))) for row in file.rows if any(row.cells)
    )
    return _Sheet(file.header, file.header_line, rows)


def _separator_of_header(text: str, headings: Mapping[str, str]) -> str | None:
    """The separator of the first line with the heading of an address; titles may stand above."""
    lines = [line for line in text.split("\n", 2 * _HEADER_WITHIN) if not is_comment(line)]
    for line in lines[:_HEADER_WITHIN]:
        for separator in sorted(";\t,", key=line.count, reverse=True):
            cells = [cell.strip(' "') for cell in line.split(separator)]
            if len(cells) > 1 and _is_header(cells, headings):
                return separator
    return None


def _is_header(cells: Sequence[str], headings: Mapping[str, str]) -> bool:
    return "address" in map(column_of, cells) or headings.get("address") in cells


def _read_workbook(path: Path, sheet: str | None, headings: Mapping[str, str]) -> _Sheet:
    try:
        import openpyxl
    except ImportError as error:
        raise SiteError(
            [
                Problem(
                    str(path),
                    "",
                    "Excel workbooks need the extra excel",
                    "install fieldlink[excel], or save the sheet as CSV",
                )
            ]
        ) from error
    import pandas as pd

    assert openpyxl is not None
    with explained_workbook(path, SiteError), pd.ExcelFile(path, engine="openpyxl") as book:
        if sheet is not None and sheet not in book.sheet_names:
            message = f"has no sheet {sheet!r}"
            remedy = nearest(sheet, [str(name) for name in book.sheet_names])
            raise SiteError([Problem(str(path), "", message, remedy)])
        frame = pd.read_excel(
            book,
            sheet_name=0 if sheet is None else sheet,
            header=None,
            dtype=str,
            keep_default_na=False,
        )
    lines = [
        (number, tuple(str(cell).strip() for cell in row))
        for number, row in enumerate(frame.itertuples(index=False), start=1)
    ]
    for at, (number, cells) in enumerate(lines[:_HEADER_WITHIN]):
        if _is_header(cells, headings):
            return _Sheet(cells, number, tuple(row for row in lines[at + 1 :] if any(row[1])))
    remedy = "name a column address, or another sheet with --sheet"
    message = f"no heading of an address in the first {_HEADER_WITHIN} rows"
    raise SiteError([Problem(str(path), "", message, remedy)])


def _columns(
    path: Path, table: _Sheet, headings: Mapping[str, str]
) -> tuple[dict[str, int], list[str]]:
    """Return the place of every known column, and what was made of the headings."""
    columns = _named_columns(path, table, headings)
    notes = [f"column {headings[column]!r} is {column}, as you said" for column in columns]
    for number, heading in enumerate(table.header):
        if number in columns.values():
            continue
        column = column_of(heading)
        if column is None or column in columns:
            if heading:
                notes.append(f"column {heading!r} is left out")
            continue
        if column == "offset" and _counts_up(cells[number] for _, cells in table.rows):
            notes.append(
                f"column {heading!r} counts up row by row, as places in a data block do, and is "
                f"left out; if it is added to the values, give --column offset={heading!r}"
            )
            continue
        columns[column] = number
        if heading != column:
            notes.append(f"column {heading!r} is taken as {column}")
    problems = [
        Problem(
            str(path),
            name,
            "no heading is known to mean it",
            f"name its heading with --column {name}=HEADING",
            table.header_line,
        )
        for name in REQUIRED
        if name not in columns
    ]
    if problems:
        raise SiteError(problems)
    return columns, notes


def _counts_up(cells: Iterable[str]) -> bool:
    """Whether every cell is a number above that of the row before: 0.0, 4.0, 8.0 of a DB."""
    texts = [cell.strip() for cell in cells]
    if len(texts) < _ROWS_OF_PLACES or not all(map(_PLACE.fullmatch, texts)):
        return False
    places = [tuple(map(int, text.replace(",", ".").split("."))) for text in texts]
    return all(before < after for before, after in pairwise(places))


def _named_columns(path: Path, table: _Sheet, headings: Mapping[str, str]) -> dict[str, int]:
    columns: dict[str, int] = {}
    problems = []
    for column, heading in headings.items():
        if column not in (*COLUMNS, *LIST_COLUMNS):
            message = "a register map has no such column"
            remedy = nearest(column, (*COLUMNS, *LIST_COLUMNS))
            problems.append(Problem(str(path), column, message, remedy))
        elif heading not in table.header:
            message, remedy = (
                f"no column has the heading {heading!r}",
                nearest(heading, table.header),
            )
            problems.append(Problem(str(path), column, message, remedy, table.header_line))
        else:
            columns[column] = table.header.index(heading)
    if problems:
        raise SiteError(problems)
    return columns


def _about(style: AddressStyle, *, guessed: bool) -> str:
    said = {
        "zero": "addresses count from 0, as requests do",
        "one": "addresses count from 1: 1 is address 0",
        "hex": "addresses are hexadecimal and count from 0: 0010 is address 16",
        "modicon": "addresses are written with their table: 40001 is holding register 0, 30001 "
        "input register 0, 10001 discrete input 0, 00001 coil 0",
    }[style]
    hint = "; if the manual counts from 1, give --addresses one" if style == "zero" else ""
    return said + (hint if guessed else "")


def _translate(
    path: Path, line: int, values: dict[str, str], style: AddressStyle
) -> Problem | None:
    """Put a row into the register map's own words; the problem with its address, if any."""
    for column in ("table", "type", "order", "writable"):
        if column in values:
            values[column] = meaning_of(column, values[column])
    if "read_only" in values:
        # Only a plain no lets anything be written.
        may_write = values["read_only"].strip().lower() in ("no", "false", "0")
        values.setdefault("writable", "yes" if may_write else "no")
    if long := _LONG_TEXT.fullmatch(values["type"].strip()):
        # Vendors count characters there.
        values["type"] = DataType.STRING.value
        values.setdefault("length", "")
        values["length"] = values["length"] or str((int(long[1]) + 1) // 2)
    try:
        found = parse_address(values["address"], style)
    except ValueError as error:
        message, _, remedy = str(error).partition("; ")
        return Problem(str(path), "address", message, remedy, line)
    values["address"] = str(found.address)
    if problem := _scale(path, line, values):
        return problem
    if found.table is not None:
        if values.get("table") and values["table"] != found.table.value:
            message = f"{values['table']} is given for an address of the table {found.table}"
            return Problem(str(path), "table", message, "correct one of them", line)
        values["table"] = found.table.value
    if found.registers is not None:
        values["length"] = values.get("length") or str(found.registers)
    if found.bit is not None:
        values["bit"] = str(found.bit)
        values["type"] = DataType.BOOL.value
    if values["type"] in list(DataType) and values["type"] != DataType.STRING:
        # A list that gives every row's registers says nothing new, or something wrong.
        own = DataType(values["type"]).registers
        if values.get("length") in (str(own), str(16 * own)):
            # In registers, or in bits.
            values["length"] = ""
    return None


def _scale(path: Path, line: int, values: dict[str, str]) -> Problem | None:
    """Put a row's divisor, decimals and range into scale, low and high."""
    try:
        values["scale"] = scale_cell(values)
    except ValueError as error:
        column, message, remedy = str(error).split("; ", 2)
        return Problem(str(path), column, message, remedy, line)
    ends = limits(values.get("range", ""))
    is_number = values["type"] not in (DataType.STRING, DataType.BOOL)
    if ends is not None and is_number and not (values.get("low") or values.get("high")):
        values["low"], values["high"] = ends
    return None


def _about_scales(table: _Sheet, columns: Mapping[str, int], tags: Mapping[str, Tag]) -> list[str]:
    """What the reader of a list should compare with the operator's screen."""
    notes = []
    if "decimals" in columns and "scale" in columns:
        notes.append(f"{table.header[columns['decimals']]!r} counts where the scale is empty")
    if "range" in columns:
        cells = [cells[columns["range"]] for _, cells in table.rows]
        left = sum(bool(cell) and limits(cell) is None for cell in cells)
        if left:
            heading = table.header[columns["range"]]
            notes.append(f"{heading!r} of {left} rows is not a range such as 0..100: left out")
    larger = [tag for tag in tags.values() if tag.scale >= 10.0]
    if larger and "scale" in columns and "divisor" not in columns:
        tag, heading = larger[0], table.header[columns["scale"]]
        notes.append(
            f"{heading!r} multiplies: a raw 100 of {tag.name} is "
            f"{100.0 * tag.scale + tag.offset:g} {tag.unit}".rstrip()
            + f"; if the register holds {tag.scale:g} times the value, give "
            f"--column divisor={heading!r}"
        )
    return notes


def _cells(values: Mapping[str, str]) -> Callable[[str], str]:
    return lambda column: values.get(column, "")


def _number(cell: str) -> float:
    """Return a number as vendors write it: 0.1, 0,1, 1/10."""
    if "," in cell and may_group(cell):
        raise ValueError(cell)
    text = cell.replace(",", ".", 1) if "." not in cell else cell
    over = re.fullmatch(r"\s*1\s*/\s*(\d+)\s*", text)
    if "_" in text:
        raise ValueError(cell)
    value = 1.0 / float(over[1]) if over and int(over[1]) else float(text)
    if value - value != 0.0:
        raise ValueError(cell)
    return value
