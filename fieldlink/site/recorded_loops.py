"""Which loops a recorded table holds, each as a table of its own.

    find_loops(read_recorded_table(Path("plant.csv"), ()), {})   # {"FC101": ..., "LC7": ...}

Loops are told apart by a column ``loop`` or by tags in rows of a value (`long_form`), or stand side
by side (``FC101.OP,FC101.PV,LC7.OP,LC7.PV``). The only loop of a table has no name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from fieldlink.site.column_names import loops_side_by_side, note_of_left_out
from fieldlink.site.csv_file import CsvFile, CsvRow
from fieldlink.site.errors import RecordingError, several_loops
from fieldlink.site.long_columns import find_long_columns
from fieldlink.site.long_form import LoopTable, tables_by_loop
from fieldlink.site.recorded_table import RecordedTable
from fieldlink.spreadsheet import from_cell

__all__ = ["distinct_names", "find_loops", "refuse_several"]


def find_loops(
    table: RecordedTable,
    wanted: Mapping[str, str | None],
    *,
    needs_pv: bool = True,
    beside: bool = True,
) -> dict[str, LoopTable | RecordingError]:
    """Return the loops of a table by name; an error in place of one that cannot be used.

    Args:
        table: of a recording.
        wanted: names of columns or tags by role, None for one that is to be found. With a name for
            OP or PV loops side by side are one loop.
        needs_pv: as for `recording.read_recording`.
        beside: whether loops side by side are told apart; otherwise they are one table.

    Raises:
        RecordingError: see `long_form.tables_by_loop`.
    """
    file, notes = table.file, table.notes
    long = find_long_columns(file.header)
    if long is not None:
        tables = tables_by_loop(file, long, wanted, needs_pv=needs_pv)
        return {
            name: own
            if isinstance(own, RecordingError)
            else replace(own, notes=(*notes, *own.notes))
            for name, own in tables.items()
        }
    if by_name := _rows_by_loop(file):
        return {
            name: LoopTable(replace(file, rows=tuple(rows)), wanted, notes)
            for name, rows in by_name.items()
        }
    is_named = wanted.get("op") is not None or wanted.get("pv") is not None
    if beside and not is_named and (found := loops_side_by_side(file.header)):
        beside_others = (f"one of {len(found)} loops side by side",) if len(found) > 1 else ()
        notes = (*notes, *beside_others, *note_of_left_out(file.header))
        return {name: LoopTable(file, {**wanted, **roles}, notes) for name, roles in found.items()}
    return {"": LoopTable(file, wanted, notes)}


def refuse_several(table: RecordedTable, loops: Sequence[str]) -> None:
    """Refuse a table of several loops that a column tells apart, where none was named.

    Raises:
        RecordingError: it has several.
    """
    header = table.file.header
    long = find_long_columns(header)
    number = _loop_column(header) if long is None else long.tag
    if len(loops) > 1 and number is not None:
        raise RecordingError([several_loops(str(table.file.path), header[number], loops)])


def distinct_names(places: Sequence[tuple[str, str]]) -> list[str]:
    """Return a name for each loop of several files: its own, or its file's and its own.

    Args:
        places: name of the file, different for each file, and name of the loop in it; empty for the
            only loop of a file, which has the file's name.
    """
    own = [loop or file for file, loop in places]
    whole = [f"{file}/{loop}" if loop else file for file, loop in places]
    while twice := {name for name, count in Counter(own).items() if count > 1}:
        apart = [full if name in twice else name for name, full in zip(own, whole, strict=True)]
        if apart == own:
            raise ValueError(f"one loop stands twice in a file: {', '.join(sorted(twice))}")
        own = apart
    return own


def _loop_column(header: Sequence[str]) -> int | None:
    return next((n for n, name in enumerate(header) if name.lower() == "loop"), None)


def _rows_by_loop(file: CsvFile) -> dict[str, list[CsvRow]]:
    """The rows of each loop that a column ``loop`` names; nothing without such a column."""
    number = _loop_column(file.header)
    rows: dict[str, list[CsvRow]] = {}
    if number is None:
        return rows
    for row in file.rows:
        rows.setdefault(from_cell(row.cells[number]), []).append(row)
    return rows
