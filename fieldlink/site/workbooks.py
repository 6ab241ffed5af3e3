"""Excel workbooks: what is wrong with one that cannot be read, in words.

    with explained_workbook(path, RecordingError):
        book = load_workbook(path)

openpyxl raises whatever its parts raise, and warns of what it leaves out (a data validation, a date
beyond its calendar). Neither changes the values that are read.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from fieldlink.errors import FieldlinkError
from fieldlink.site.errors import Problem, RecordingError, SiteError

__all__ = ["OLE", "explained_workbook", "why_no_xlsx"]

OLE = b"\xd0\xcf\x11\xe0"
"""First bytes of a compound file: a workbook of Excel 97-2003, or one behind a password."""

_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
"""Name of the stream that holds an encrypted .xlsx ([MS-OFFCRYPTO], 2.3.4.4)."""

_UNREADABLE = (
    *(ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError),
    *(BadZipFile, EOFError, SyntaxError, zlib.error),
)
"""What zipfile, openpyxl and its XML parsers raise over a damaged file; a SyntaxError is XML's."""


@contextmanager
def explained_workbook(
    path: Path, error_type: type[SiteError] | type[RecordingError]
) -> Iterator[None]:
    """Turn what is raised while a workbook is read into one problem; hide openpyxl's warnings.

    Raises:
        SiteError, RecordingError: as ``error_type`` says; what is explained already passes.
    """
    from openpyxl.utils.exceptions import InvalidFileException

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="openpyxl")
        try:
            yield
        except FieldlinkError:
            raise
        except (*_UNREADABLE, InvalidFileException) as error:
            what, remedy = _explain(path, error)
            raise error_type([Problem(str(path), "", what, remedy)]) from error


def why_no_xlsx(path: Path) -> tuple[str, str] | None:
    """Return what a compound file is, and the remedy; None for any other file.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        if stream.read(len(OLE)) != OLE:
            return None
        stream.seek(0)
        is_locked = _ENCRYPTED in stream.read()
    if is_locked:
        return (
            "is a workbook behind a password or a sensitivity label",
            "save it without protection, or as CSV",
        )
    return "is a workbook of Excel 97-2003", "save it as .xlsx or CSV"


def _explain(path: Path, error: Exception) -> tuple[str, str]:
    try:
        if (found := why_no_xlsx(path)) is not None:
            return found
        with ZipFile(path) as archive:
            names = archive.namelist()
            is_locked = any(entry.flag_bits & 1 for entry in archive.infolist())
    except BadZipFile:
        return "is a binary file and no workbook", "save it as .xlsx or CSV"
    except OSError as unread:
        return f"cannot be read ({unread.strerror or unread})", "check the path and its permissions"
    if not any(name.startswith("xl/") for name in names):
        return "is a ZIP file and no workbook", "unpack it first"
    if is_locked:
        return "is a workbook behind a password", "save it without protection, or as CSV"
    said = " ".join(str(error).split())
    return f"is a damaged workbook ({said})", "open it in Excel and save it again, or as CSV"
