"""Register maps: CSV files that name a device's tags. Every bad row is reported at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from fieldlink.registers import DataType, Order, Table, Tag
from fieldlink.site.csv_file import CsvFile, CsvRow, read_csv
from fieldlink.site.errors import Problem, SiteError, nearest

__all__ = ["COLUMNS", "read_register_map"]

REQUIRED = ("tag", "address", "type")
COLUMNS = (
    "tag",
    "table",
    "address",
    "type",
    "scale",
    "offset",
    "unit",
    "low",
    "high",
    "writable",
    "comment",
)

_LAST_ADDRESS = 0xFFFF
_BOOLEANS = {
    "": False,
    "true": True,
    "yes": True,
    "1": True,
    "false": False,
    "no": False,
    "0": False,
}

T = TypeVar("T")


def read_register_map(
    path: Path, *, word_order: Order = "big", byte_order: Order = "big"
) -> Mapping[str, Tag]:
    """Return the tags of a register map by name, in the order of the file.

    Raises:
        SiteError: every bad row, duplicate tag and overlap of registers in the file.
    """
    file = read_csv(path, SiteError)
    columns = _columns(file)
    tags: dict[str, Tag] = {}
    lines: dict[str, int] = {}
    problems: list[Problem] = []
    for row in file.rows:
        if not any(row.cells):
            continue
        reader = _RowReader(file, row, columns)
        tag = reader.tag(word_order, byte_order)
        if tag is not None and tag.name in tags:
            reader.report("tag", f"{tag.name} is already on line {lines[tag.name]}", "rename one")
        elif tag is not None:
            tags[tag.name] = tag
            lines[tag.name] = row.line
        problems.extend(reader.problems)
    problems.extend(_overlaps(str(path), tags, lines))
    if not tags and not problems:
        problems.append(Problem(str(path), "", "has no tags", "add a row for every tag"))
    if problems:
        raise SiteError(problems)
    return tags


def _columns(file: CsvFile) -> dict[str, int]:
    columns: dict[str, int] = {}
    problems: list[Problem] = []
    for number, name in enumerate(name.lower() for name in file.header):
        if name not in COLUMNS:
            remedy = nearest(name, COLUMNS)
            problems.append(
                Problem(str(file.path), name, "unknown column", remedy, file.header_line)
            )
        elif name in columns:
            problems.append(
                Problem(str(file.path), name, "column given twice", "remove one", file.header_line)
            )
        columns[name] = number
    for name in REQUIRED:
        if name not in columns:
            problems.append(
                Problem(str(file.path), name, "column is missing", "add it", file.header_line)
            )
    if problems:
        raise SiteError(problems)
    return columns


class _RowReader:
    """Reads one row cell by cell and collects what is wrong with it."""

    def __init__(self, file: CsvFile, row: CsvRow, columns: Mapping[str, int]) -> None:
        self._file = file
        self._row = row
        self._columns = columns
        self.problems: list[Problem] = []

    def report(self, column: str, message: str, remedy: str) -> None:
        self.problems.append(Problem(str(self._file.path), column, message, remedy, self._row.line))

    def tag(self, word_order: Order, byte_order: Order) -> Tag | None:
        """Return the row's tag, None when something is wrong with it."""
        name = self._cell("tag")
        if not name:
            self.report("tag", "the tag has no name", "name it")
        table = self._choice("table", {item.value: item for item in Table}, Table.HOLDING)
        data_type = self._choice("type", {item.value: item for item in DataType}, None)
        address = self._address()
        scale = self._number("scale", 1.0)
        offset = self._number("offset", 0.0)
        low, high = self._number("low", None), self._number("high", None)
        writable = self._choice("writable", _BOOLEANS, False)
        if scale == 0.0:
            self.report("scale", "a scale of 0 loses the value", "give engineering units per count")
        if low is not None and high is not None and low >= high:
            self.report(
                "low", f"low = {low:g} is not below high = {high:g}", "exchange or correct them"
            )
        if table is not None and data_type is not None:
            if table.is_bits and data_type is not DataType.BOOL:
                self.report("type", f"a {table} is one bit, not {data_type}", "use bool")
            elif address is not None and address + data_type.registers - 1 > _LAST_ADDRESS:
                last = address + data_type.registers - 1
                self.report(
                    "address", f"{data_type} at {address} ends at {last}", "end at 65535 or below"
                )
        if table is not None and writable and not table.is_writable:
            self.report(
                "writable", f"{table} cannot be written", "use holding or coil, or write no"
            )
        if self.problems or table is None or data_type is None or address is None:
            return None
        return Tag(
            name=name,
            table=table,
            address=address,
            data_type=data_type,
            scale=1.0 if scale is None else scale,
            offset=offset or 0.0,
            unit=self._cell("unit"),
            low=low,
            high=high,
            writable=bool(writable),
            comment=self._cell("comment"),
            word_order=word_order,
            byte_order=byte_order,
        )

    def _cell(self, column: str) -> str:
        number = self._columns.get(column)
        return "" if number is None else self._row.cells[number]

    def _choice(self, column: str, choices: Mapping[str, T], default: T | None) -> T | None:
        cell = self._cell(column).lower()
        if not cell and default is not None:
            return default
        if cell not in choices:
            message = f"{self._cell(column)!r} is unknown" if cell else "is empty"
            self.report(column, message, nearest(cell, [name for name in choices if name]))
            return None
        return choices[cell]

    def _number(self, column: str, default: float | None) -> float | None:
        cell = self._cell(column)
        if not cell:
            return default
        try:
            return self._file.number(cell)
        except ValueError:
            self.report(column, f"{cell!r} is no number", "give a number or leave it empty")
            return default

    def _address(self) -> int | None:
        cell = self._cell("address")
        try:
            address = int(cell)
        except ValueError:
            message = f"{cell!r} is no whole number" if cell else "is empty"
            self.report("address", message, "give the 0-based address, for 40001 that is 0")
            return None
        if not 0 <= address <= _LAST_ADDRESS:
            remedy = "give the 0-based address, for 40001 that is 0"
            self.report("address", f"{address} is outside 0 to {_LAST_ADDRESS}", remedy)
            return None
        return address


def _overlaps(file: str, tags: Mapping[str, Tag], lines: Mapping[str, int]) -> list[Problem]:
    """Tags may be views of the same registers; any other sharing is a mistake."""
    problems = []
    ordered = sorted(tags.values(), key=lambda tag: (tag.table, tag.address, tag.end, tag.name))
    for before, tag in _neighbours(ordered, lambda a, b: a.table is b.table and b.address < a.end):
        if (before.address, before.data_type) == (tag.address, tag.data_type):
            continue
        if before.address == tag.address:
            what = f"has the registers of {before.name} (line {lines[before.name]}) as another type"
            remedy = "give both the same type or move one"
        else:
            what = f"begins inside {before.name} (line {lines[before.name]})"
            remedy = f"{before.name} ends at {before.end - 1}: move one of them"
        message = f"{tag.name} ({_span(tag)}) {what} ({_span(before)})"
        problems.append(Problem(file, "address", message, remedy, lines[tag.name]))
    return problems


def _neighbours(ordered: list[Tag], share: Callable[[Tag, Tag], bool]) -> list[tuple[Tag, Tag]]:
    """Return every tag with the furthest-reaching tag before it, when the two share registers."""
    pairs = []
    reach: Tag | None = None
    for tag in ordered:
        if reach is not None and share(reach, tag):
            pairs.append((reach, tag))
        if reach is None or reach.table is not tag.table or tag.end > reach.end:
            reach = tag
    return pairs


def _span(tag: Tag) -> str:
    span = str(tag.address) if tag.count == 1 else f"{tag.address} to {tag.end - 1}"
    return f"{tag.data_type} at {tag.table} {span}"
