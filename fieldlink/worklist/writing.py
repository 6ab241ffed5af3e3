"""Writing a report: the ending or the option names the format, and a file appears whole or not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from fieldlink.unfinished_file import write_whole
from fieldlink.worklist.document import WorkDocument
from fieldlink.worklist.errors import ReportError

__all__ = ["FORMATS", "format_of", "render", "write_report"]


def _html(document: WorkDocument) -> bytes:
    try:
        from fieldlink.worklist.html_page import render_html
    except ImportError as error:
        raise _missing(error) from error
    return render_html(document)


def _pdf(document: WorkDocument) -> bytes:
    try:
        from fieldlink.worklist.pdf_pages import render_pdf
    except ImportError as error:
        raise _missing(error) from error
    return render_pdf(document)


def _csv(document: WorkDocument) -> bytes:
    from fieldlink.worklist.sheets import render_csv

    return render_csv(document)


def _xlsx(document: WorkDocument) -> bytes:
    from fieldlink.worklist.sheets import render_xlsx

    return render_xlsx(document)


FORMATS: Mapping[str, Callable[[WorkDocument], bytes]] = {
    "html": _html,
    "pdf": _pdf,
    "csv": _csv,
    "xlsx": _xlsx,
}
"""What makes each format; the name is the file's ending."""


def format_of(path: Path | None, wanted: str | None) -> str:
    """Return the format that is wanted, or that of the file's ending; HTML where neither names one.

    Raises:
        ReportError: an unknown ending, or that of another format than is wanted.
    """
    ending = "" if path is None else path.suffix.lower().removeprefix(".")
    if wanted is not None:
        if ending in FORMATS and ending != wanted:
            raise ReportError(
                f"{path}: --format {wanted} does not fit a file that ends in .{ending}; leave "
                f"--format out, or end the name in .{wanted}"
            )
        return wanted
    if ending in FORMATS:
        return ending
    if ending:
        raise ReportError(
            f"{path}: .{ending} is not a kind of report; end it in .html, .pdf, .csv or .xlsx, or "
            "name the format with --format"
        )
    return "html"


def render(document: WorkDocument, kind: str) -> bytes:
    """Return a report in one of `FORMATS`.

    Raises:
        ReportError: the format needs a package that is not installed.
    """
    return FORMATS[kind](document)


def write_report(document: WorkDocument, path: Path, kind: str) -> None:
    """Write a report; a reader of ``path`` sees the whole file or the one before.

    Raises:
        ReportError: the file cannot be written, or the format needs a package.
    """
    content = render(document, kind)
    try:
        write_whole(path, content, mode=0o640)
    except OSError as error:
        raise ReportError(
            f"{path}: the report cannot be written: {error.strerror or error}; name a "
            "folder that exists and may be written, and check the free space"
        ) from error


def _missing(error: ImportError) -> ReportError:
    return ReportError(
        f"this report needs {error.name}; pip install 'fieldlink[plot]', or write a .csv"
    )
