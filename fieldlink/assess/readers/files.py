"""Files and folders of files: which reader a file's ending calls for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import dropwhile
from pathlib import Path

from fieldlink.assess.errors import ReadingError
from fieldlink.assess.job import RECORD, RUN_FILE, Job, Piece
from fieldlink.assess.readers.base import Named, Opening
from fieldlink.errors import FieldlinkError

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
        lambda job, piece: historian_pieces(job, piece, f"sqlite:///{piece.path}"),
        lambda job, piece: historian_windows(job, piece, f"sqlite:///{piece.path}"),
    )


ENDINGS = {
    ".csv": _csv,
    ".tsv": _csv,
    ".parquet": _parquet,
    ".mat": _matlab,
    ".sqlite": _sqlite,
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
            try:
                yield from _kind(path)[0](job, whole)
            except FieldlinkError:
                yield whole

    def windows(self, job: Job, piece: Piece) -> Iterator[Named]:
        """Read a file, or a loop of it."""
        return _kind(piece.path)[1](job, piece)


def _kind(path: str) -> tuple[_Pieces, _Windows]:
    if path.lower().endswith(".mat"):
        from fieldlink.assess.readers.isdb import holds_one_loop

        if holds_one_loop(Path(path)):
            return _csv()
    return ENDINGS.get(Path(path).suffix.lower(), _csv)()


def _files(where: str, shown: str) -> Iterator[tuple[str, str]]:
    """Yield path and shown name of each file, a folder at a time: no list of them all is made."""
    if not Path(where).is_dir():
        yield where, shown
        return

    def refuse(error: OSError) -> None:
        raise ReadingError(
            f"{error.filename}: the folder cannot be read ({error.strerror}); check its permissions"
        )

    for folder, folders, names in os.walk(where, onerror=refuse):
        if RUN_FILE in names or {RECORD, "loops.csv"} <= set(names):
            # The folder of a run: its tables are no recordings.
            folders.clear()
            continue
        folders.sort()
        for name in sorted(names):
            if Path(name).suffix.lower() in ENDINGS:
                path = Path(folder) / name
                yield str(path), str(Path(shown) / path.relative_to(where))
