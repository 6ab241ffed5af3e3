"""Files and folders of files: which reader a file's ending calls for."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import dropwhile
from pathlib import Path

from fieldlink.assess.errors import PlaceAwayError, ReadingError
from fieldlink.assess.job import RECORD, RUN_FILE, Job, Piece, Place
from fieldlink.assess.readers.base import Named, Opening
from fieldlink.errors import FieldlinkError
from fieldlink.file_at import is_pipe_or_device
from fieldlink.printable import as_text
from fieldlink.site.long_columns import find_long_columns
from fieldlink.site.recording import HIDDEN, PACKED, PARQUET
from fieldlink.sqlite_url import sqlite_url

__all__ = ["ENDINGS", "FileReader"]

_Pieces = Callable[[Job, Piece], Iterator[Piece]]
_Windows = Callable[[Job, Piece], Iterator[Named]]


def _csv() -> tuple[_Pieces, _Windows]:
    from fieldlink.assess.readers.csv_recordings import csv_pieces, csv_windows

    return csv_pieces, csv_windows


def _parquet() -> tuple[_Pieces, _Windows]:
    from fieldlink.assess.readers.parquet_recordings import parquet_pieces, parquet_windows

    return parquet_pieces, parquet_windows


def _matlab() -> tuple[_Pieces, _Windows]:
    from fieldlink.assess.readers.isdb_recordings import isdb_pieces, isdb_windows

    return isdb_pieces, isdb_windows


def _sqlite() -> tuple[_Pieces, _Windows]:
    from fieldlink.assess.readers.historian_samples import historian_pieces, historian_windows

    return (
        lambda job, piece: historian_pieces(job, piece, sqlite_url(piece.path)),
        lambda job, piece: historian_windows(job, piece, sqlite_url(piece.path)),
    )


ENDINGS = {
    ".csv": _csv,
    ".tsv": _csv,
    ".xlsx": _csv,
    **dict.fromkeys(PARQUET, _parquet),
    ".mat": _matlab,
    ".sqlite": _sqlite,
    **dict.fromkeys(PACKED, _csv),
}
"""The files of a folder that are read; a file that is named itself may end otherwise: it is CSV."""


class FileReader:
    """A place that is a file, or a folder with all folders in it."""

    def pieces(self, job: Job, place: int, after: str) -> Iterator[Piece | Opening]:
        """List the files in the order of their names, and the loops in those that hold several.

        A file that cannot be opened is a piece of its own: reading it says what is wrong.
        """
        files = _files(job.places[place].where, job.places[place].shown)
        if after:
            files = dropwhile(lambda file: file[0] != after, files)
            next(files, None)
        for path, shown in files:
            whole = Piece(place, shown, path)
            yield Opening(whole)
            if _refusal(path):
                yield whole
                continue
            try:
                yield from _kind(path)[0](job, whole)
            except Exception:  # noqa: BLE001  (reading it says what is wrong; the others go on)
                yield whole

    def windows(self, job: Job, piece: Piece) -> Iterator[Named]:
        """Read a file, or a loop of it."""
        try:
            if refusal := _refusal(piece.path):
                raise ReadingError(refusal)
            yield from _kind(piece.path)[1](job, piece)
        except FieldlinkError as error:
            place = job.places[piece.place]
            if piece.path != place.where and (why := _why_away(place)):
                raise PlaceAwayError(why) from error
            raise


def _kind(path: str) -> tuple[_Pieces, _Windows]:
    if path.lower().endswith(".mat"):
        from fieldlink.assess.readers.isdb import holds_one_loop

        if holds_one_loop(Path(path)):
            return _csv()
    if path.lower().endswith(PARQUET) and _has_a_row_for_each_value(path):
        return _csv()
    return ENDINGS.get(Path(path).suffix.lower(), _csv)()


def _has_a_row_for_each_value(path: str) -> bool:
    """Whether a Parquet file is in long form, which is read as a whole."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        names = pq.read_schema(path).names
    except (OSError, pa.ArrowException):
        # Reading it says why.
        return False
    return find_long_columns(names) is not None


def _files(where: str, shown: str) -> Iterator[tuple[str, str]]:
    """Yield path and shown name of each file, a folder at a time: no list of them all is made.

    A folder that a link leads to is read too, each folder once: a link to a folder above would
    otherwise be followed for ever. A folder in it that cannot be listed is yielded itself, and
    reading it says why; it costs the others nothing.
    """
    if not os.path.isdir(where):
        yield where, shown
        return
    closed: list[str] = []
    seen: set[tuple[int, int]] = set()
    for folder, folders, names in os.walk(
        where, onerror=lambda error: closed.append(str(error.filename)), followlinks=True
    ):
        yield from _of_folders(closed, where, shown)
        closed.clear()
        folders[:] = sorted(name for name in folders if not name.startswith(HIDDEN))
        if RUN_FILE in names or {RECORD, "loops.csv"} <= set(names) or _is_known(folder, seen):
            # The folder of a run: its tables are not recordings. Or one that was read already.
            folders.clear()
            continue
        for name in sorted(names):
            path = Path(folder) / name
            is_meant = path.suffix.lower() in ENDINGS and not name.startswith(HIDDEN)
            if is_meant and not _is_other_database(path):
                yield str(path), _shown(path, where, shown)
    if where in closed:
        raise ReadingError(f"the folder {shown} {_why_closed(where)}")
    yield from _of_folders(closed, where, shown)


def _is_other_database(path: Path) -> bool:
    """Whether a file is a sound SQLite database without samples, as one beside a historian."""
    if path.suffix.lower() != ".sqlite":
        return False
    query = "SELECT COUNT(*), SUM(name = 'samples') FROM sqlite_master WHERE type = 'table'"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
            tables, samples = database.execute(query).fetchone()
    except sqlite3.Error:
        # Reading it says what is wrong with it.
        return False
    return bool(tables > 0 and samples == 0)


def _is_known(folder: str, seen: set[tuple[int, int]]) -> bool:
    """Whether a folder was met before, under whatever name; it is then known."""
    try:
        found = os.stat(folder)
    except OSError:
        # It went away meanwhile: then it is not met again.
        return True
    key = (found.st_dev, found.st_ino)
    known = key in seen
    seen.add(key)
    return known


def _of_folders(paths: list[str], where: str, shown: str) -> Iterator[tuple[str, str]]:
    for path in paths:
        if path != where:
            yield path, _shown(Path(path), where, shown)


def _shown(path: Path, where: str, shown: str) -> str:
    return as_text(str(Path(shown) / path.relative_to(where)))


def _refusal(path: str) -> str | None:
    """Why a path is not opened: opening a pipe would wait for a writer without end."""
    if os.path.isdir(path):
        return f"the folder {_why_closed(path)}"
    if is_pipe_or_device(path):
        return "is a pipe or a device; give a file"
    if Path(path).suffix.lower() in (*PARQUET, ".sqlite") and as_text(path) != path:
        return "has a name that is not UTF-8, which the libraries of its format refuse; rename it"
    return None


def _why_away(place: Place) -> str | None:
    """Why nothing in a folder can be read now, as when a network folder is unmounted."""
    try:
        with os.scandir(place.where) as entries:
            what = None if next(entries, None) else "is empty now"
    except OSError as error:
        what = f"is out of reach ({error.strerror})"
    return what and f"the folder {place.shown} {what}; check that it is mounted"


def _why_closed(folder: str) -> str:
    try:
        os.scandir(folder).close()
    except OSError as error:
        return f"cannot be listed ({error.strerror}); check its permissions"
    return "could not be listed when the run began; give it to a run of its own"
