"""The work list as CSV and as an Excel workbook: a row a loop, the columns of `COLUMNS`.

Text from outside cannot become a formula in either.
"""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from fieldlink.spreadsheet import to_cell
from fieldlink.worklist.document import WorkDocument
from fieldlink.worklist.errors import ReportError
from fieldlink.worklist.row import COLUMNS

__all__ = ["render_csv", "render_xlsx"]


def render_csv(document: WorkDocument) -> bytes:
    """Return the list as CSV in UTF-8, with the line ends of RFC 4180."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow(COLUMNS)
    for row in document.to_dict()["loops"]:
        writer.writerow([_cell(row[name]) for name in COLUMNS])
    return stream.getvalue().encode("utf-8")


def render_xlsx(document: WorkDocument) -> bytes:
    """Return the list as a workbook, its heading frozen and with a filter.

    Raises:
        ReportError: openpyxl is not installed.
    """
    try:
        from openpyxl import Workbook
        from openpyxl.cell import WriteOnlyCell
        from openpyxl.styles import Font
    except ImportError as error:
        raise ReportError(
            "workbooks need openpyxl; pip install 'fieldlink[excel]', or write a .csv"
        ) from error
    book = Workbook(write_only=True)
    sheet = book.create_sheet("work list")
    sheet.freeze_panes = "C2"
    heading = []
    for name in COLUMNS:
        cell = WriteOnlyCell(sheet, name)
        cell.font = Font(bold=True)
        heading.append(cell)
    sheet.append(heading)
    rows = document.to_dict()["loops"]
    for row in rows:
        sheet.append([_cell(row[name]) for name in COLUMNS])
    sheet.auto_filter.ref = f"A1:{_letters(len(COLUMNS))}{len(rows) + 1}"
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def _cell(value: Any) -> Any:
    """A value as a cell: lists as sentences, objects as JSON, yes and no in words."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return to_cell("; ".join(map(str, value)))
    if isinstance(value, dict):
        return json.dumps(value)
    return to_cell(value) if isinstance(value, str) else value


def _letters(number: int) -> str:
    from openpyxl.utils import get_column_letter

    return str(get_column_letter(number))
