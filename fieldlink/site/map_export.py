"""Register maps written: what `read_register_map` reads back as the same tags."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from fieldlink.registers import DataType, Tag
from fieldlink.registers.types import order_name
from fieldlink.site.errors import Problem, SiteError
from fieldlink.site.map_row import COLUMNS, REQUIRED
from fieldlink.spreadsheet import to_cell
from fieldlink.unfinished_file import write_whole

__all__ = ["map_as_csv", "map_rows", "write_map"]


def map_rows(tags: Iterable[Tag]) -> list[dict[str, str]]:
    """Return the rows of a register map, cells by column; what is a default is left empty."""
    return [_row(tag) for tag in tags]


def map_as_csv(tags: Iterable[Tag]) -> str:
    """Return a register map as CSV text, with the columns that any tag uses."""
    rows = map_rows(tags)
    columns = _used(rows)
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: to_cell(cell) for name, cell in row.items()} for row in rows)
    return text.getvalue()


def write_map(tags: Iterable[Tag], path: Path) -> None:
    """Write a register map as CSV, or as an Excel workbook when ``path`` ends in .xlsx.

    Raises:
        SiteError: it cannot be written.
    """
    try:
        if path.suffix.lower() != ".xlsx":
            write_whole(path, map_as_csv(tags).encode())
            return
        import pandas as pd

        rows = map_rows(tags)
        frame = pd.DataFrame(rows, columns=_used(rows))
        content = io.BytesIO()
        with pd.ExcelWriter(content, engine="openpyxl") as book:
            frame.to_excel(book, sheet_name="registers", index=False)
            for row in book.sheets["registers"].iter_rows():
                for cell in row:
                    if cell.data_type == "f":
                        # No cell of ours is a formula: one that begins like it is a name.
                        cell.data_type = "s"
        write_whole(path, content.getvalue())
    except ImportError as error:
        remedy = "install fieldlink[excel], or write a .csv"
        message = "Excel workbooks need the extra excel"
        raise SiteError([Problem(str(path), "", message, remedy)]) from error
    except OSError as error:
        message = f"cannot be written ({error.strerror or error})"
        raise SiteError([Problem(str(path), "", message, "choose another path")]) from error


def _used(rows: list[dict[str, str]]) -> list[str]:
    return [c for c in COLUMNS if c in REQUIRED or any(row[c] for row in rows)]


def _row(tag: Tag) -> dict[str, str]:
    in_registers = not tag.table.is_bits
    cells: Mapping[str, str] = {
        "tag": tag.name,
        "table": tag.table.value,
        "address": str(tag.address),
        "type": tag.data_type.value,
        "bit": "" if tag.bit is None else str(tag.bit),
        "length": str(tag.length) if tag.data_type is DataType.STRING else "",
        "order": order_name(tag.word_order, tag.byte_order) if in_registers else "",
        "scale": "" if tag.scale == 1.0 else repr(tag.scale),
        "offset": "" if tag.offset == 0.0 else repr(tag.offset),
        "unit": tag.unit,
        "low": "" if tag.low is None else repr(tag.low),
        "high": "" if tag.high is None else repr(tag.high),
        "outside": "clamp" if tag.clamp else "",
        "invalid": " ".join(
            [*(f"0x{bits:X}" for bits in tag.invalid_patterns), *map(repr, tag.invalid)]
        ),
        "writable": "yes" if tag.writable else "",
        "every": repr(tag.every) if tag.every else "",
        "comment": tag.comment,
    }
    return {column: cells.get(column, "") for column in COLUMNS}
