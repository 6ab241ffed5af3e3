"""Node maps: the register map of an OPC UA device, with a node id for each tag.

The columns that both kinds have mean the same. A tag's place among the others stands for its
address, so that everything above the link treats both kinds alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from fieldlink.registers import DataType, Tag
from fieldlink.site.csv_file import CsvRow, read_csv
from fieldlink.site.errors import SiteError
from fieldlink.site.map_row import NUMBER_COLUMNS, RowReader
from fieldlink.site.opcua import NODE_ID
from fieldlink.site.register_map import collect_tags, find_columns
from fieldlink.spreadsheet import from_cell

__all__ = ["NODE_COLUMNS", "read_node_map"]

NODE_COLUMNS = ("tag", "node", *NUMBER_COLUMNS, "comment")

_TYPE = DataType.FLOAT64
"""Every number of OPC UA fits a double, but for 64-bit counts above 2^53."""


def read_node_map(path: Path) -> Mapping[str, Tag]:
    """Return the tags of a node map by name, in the order of the file.

    Raises:
        SiteError: every bad row and duplicate tag in the file.
    """
    file = read_csv(path, SiteError)
    columns = find_columns(file, NODE_COLUMNS, ("tag", "node"))
    rows, nodes = [], {}
    for number, row in enumerate(row for row in file.rows if any(row.cells)):
        cell = _cells(row, columns, number * _TYPE.registers)
        reader = RowReader(str(file.path), row.line, cell, file.number)
        if NODE_ID.fullmatch(cell("node")) is None:
            reader.report(
                "node",
                f"{cell('node')!r} is not a node id",
                "write it like ns=2;s=FC101.PV or i=2258",
            )
        rows.append((row.line, reader))
        nodes[cell("tag")] = cell("node")
    tags, problems = collect_tags(str(path), rows, "big", "big")
    if problems:
        raise SiteError(problems)
    return {name: replace(tag, node=nodes[name]) for name, tag in tags.items()}


def _cells(row: CsvRow, columns: Mapping[str, int], address: int) -> Callable[[str], str]:
    given = {"table": "holding", "address": str(address), "type": _TYPE.value}

    def cell(column: str) -> str:
        number = columns.get(column)
        return given.get(column, "") if number is None else from_cell(row.cells[number])

    return cell
