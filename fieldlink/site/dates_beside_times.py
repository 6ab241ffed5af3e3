"""Times of day whose dates stand in another column.

join_dates(file, 1, ["12:00:00"])  # ["05.11.2026 12:00:00"], and a note that says so
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from fieldlink.site.column_names import DATE_WORDS
from fieldlink.site.csv_file import CsvFile
from fieldlink.site.dated_cells import is_date
from fieldlink.site.times_of_day import has_hours, spell_out_times

__all__ = ["join_dates"]

_MIDNIGHT = re.compile(r"[ T]0?0:00(?::00(?:[.,]0+)?)?\Z")
"""What stands behind a day where a workbook or a database keeps dates as moments."""


def join_dates(file: CsvFile, column: int, cells: Sequence[str]) -> tuple[Sequence[str], list[str]]:
    """Return the times with their dates, or the cells as they are; and notes of what was done.

    Args:
        file: the recording.
        column: number of the time column.
        cells: of that column.
    """
    spelled = spell_out_times(cells)
    is_clear = has_hours(next(filter(None, cells), ""))
    notes: list[str] = []
    if not is_clear and spelled is None:
        return cells, notes
    for number, heading in enumerate(file.header):
        is_dates = heading.casefold() in DATE_WORDS
        # Digits alone, as 120002, are a time only beside what is called a date.
        if number == column or not (is_clear or is_dates):
            continue
        days = [_day(row.cells[number]) for row in file.rows]
        pairs = list(zip(days, spelled or cells, strict=True))
        wrong = next((day for day, cell in pairs if cell and not is_date(day)), None)
        if wrong is None:
            note = f"time is {heading!r} and {file.header[column]!r} together"
            return [f"{day} {cell}" if cell else "" for day, cell in pairs], [note]
        if is_dates:
            notes.append(f"{heading} is left out: {wrong!r} is not a date")
    return cells, notes


def _day(cell: str) -> str:
    """The day of a moment at midnight; another cell as it is."""
    found = _MIDNIGHT.search(cell)
    return cell if found is None else cell[: found.start()]
