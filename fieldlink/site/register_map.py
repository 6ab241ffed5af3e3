"""Register maps: CSV files that name a device's tags. Every bad row is reported at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from fieldlink.registers import Order, Tag
from fieldlink.site.csv_file import CsvFile, CsvRow, read_csv
from fieldlink.site.errors import Problem, SiteError, nearest
from fieldlink.site.map_row import COLUMNS, REQUIRED, RowReader
from fieldlink.spreadsheet import from_cell

__all__ = ["COLUMNS", "collect_tags", "find_columns", "read_register_map"]


def read_register_map(
    path: Path, *, word_order: Order = "big", byte_order: Order = "big"
) -> Mapping[str, Tag]:
    """Return the tags of a register map by name, in the order of the file.

    Raises:
        SiteError: every bad row, duplicate tag and overlap of registers in the file.
    """
    file = read_csv(path, SiteError)
    remedy = f"add it; fieldlink map import {path.name} --out MAP makes a map of a maker's list"
    columns = find_columns(file, COLUMNS, REQUIRED, remedy=remedy)
    rows = [_reader(file, row, columns) for row in file.rows if any(row.cells)]
    tags, problems = collect_tags(str(path), rows, word_order, byte_order)
    if problems:
        raise SiteError(problems)
    return tags


def collect_tags(
    file: str, rows: Sequence[tuple[int, RowReader]], word_order: Order, byte_order: Order
) -> tuple[dict[str, Tag], list[Problem]]:
    """Return the tags of all good rows (line, reader) by name, and what is wrong with the others.

    Of two rows that cannot both be right, the one further down is the bad one.
    """
    tags: dict[str, Tag] = {}
    lines: dict[str, int] = {}
    problems: list[Problem] = []
    for line, reader in rows:
        tag = reader.tag(word_order, byte_order)
        if tag is not None and tag.name in tags:
            reader.report("tag", f"{tag.name} is already on line {lines[tag.name]}", "rename one")
        elif tag is not None:
            tags[tag.name] = tag
            lines[tag.name] = line
        problems.extend(reader.problems)
    good = dict(tags)
    while overlaps := _overlaps(file, good, lines):
        # Without these rows the others are a map; one of them may have hidden another overlap.
        problems.extend(overlaps)
        bad = {problem.line for problem in overlaps}
        good = {name: tag for name, tag in good.items() if lines[name] not in bad}
    if not tags and not problems:
        problems.append(Problem(file, "", "has no tags", "add a row for every tag"))
    return good, problems


def _reader(file: CsvFile, row: CsvRow, columns: Mapping[str, int]) -> tuple[int, RowReader]:
    def cell(column: str) -> str:
        number = columns.get(column)
        return "" if number is None else from_cell(row.cells[number])

    return row.line, RowReader(str(file.path), row.line, cell, file.number)


def find_columns(
    file: CsvFile, known: Sequence[str], required: Sequence[str], *, remedy: str = "add it"
) -> dict[str, int]:
    """Return the number of each column of a map by its name.

    Args:
        file: the map.
        known, required: names of columns that it may have, and has to have.
        remedy: what to do about a column that is missing.

    Raises:
        SiteError: columns that are unknown, given twice or missing.
    """
    columns: dict[str, int] = {}
    problems: list[Problem] = []
    for number, name in enumerate(name.lower() for name in file.header):
        if name not in known:
            problems.append(
                Problem(
                    str(file.path), name, "unknown column", nearest(name, known), file.header_line
                )
            )
        elif name in columns:
            problems.append(
                Problem(str(file.path), name, "column given twice", "remove one", file.header_line)
            )
        columns[name] = number
    for name in required:
        if name not in columns:
            problems.append(
                Problem(str(file.path), name, "column is missing", remedy, file.header_line)
            )
    if problems:
        raise SiteError(problems)
    return columns


def _overlaps(file: str, tags: Mapping[str, Tag], lines: Mapping[str, int]) -> list[Problem]:
    """Tags may be views of the same registers; any other sharing is a mistake."""
    problems = []
    ordered = sorted(tags.values(), key=lambda tag: (tag.table, tag.address, tag.end, tag.name))
    for before, tag in _neighbours(ordered, lambda a, b: a.table is b.table and b.address < a.end):
        same = (before.address, before.data_type) == (tag.address, tag.data_type)
        if same or before.bit is not None or tag.bit is not None:
            continue
        first, second = sorted((before, tag), key=lambda one: lines[one.name])
        if before.address == tag.address:
            what = f"has the registers of {first.name} (line {lines[first.name]}) as another type"
            remedy = "give both the same type or move one"
        else:
            how = "begins inside" if second is tag else "reaches into"
            what = f"{how} {first.name} (line {lines[first.name]})"
            remedy = f"{before.name} ends at {before.end - 1}: move one of them"
        message = f"{second.name} ({_span(second)}) {what} ({_span(first)})"
        problems.append(Problem(file, "address", message, remedy, lines[second.name]))
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
