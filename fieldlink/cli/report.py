"""``fieldlink report``: the work list of a site, a historian or recordings, for a meeting."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext
from datetime import UTC, datetime
from functools import partial as partial_of
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fieldlink.cli.outputs import refuse_source
from fieldlink.cli.progress import show_work
from fieldlink.printable import as_text
from fieldlink.sqlite_url import sqlite_url

if TYPE_CHECKING:
    from fieldlink.worklist import Finding, PartialReport, ReportedLoop, WorkListSettings
    from fieldlink.worklist.window_samples import WindowSamples

__all__ = ["report"]

_STORE_ENDINGS = (".sqlite", ".sqlite3", ".db")

Progress = Callable[[str, int, int], None]


def report(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SITE|STORE|FILE...",
            help="A site file (.toml), a historian (sqlite:///PATH, postgresql://... or a .sqlite "
            "file), or recordings (CSV, Excel, Parquet or MATLAB, of one loop or several; a folder "
            "stands for all in it).",
        ),
    ],
    audience: Annotated[
        Literal["technician", "engineer", "manager"],
        typer.Option("--for", help="Who reads it; decides which loops and columns are shown."),
    ] = "engineer",
    kind: Annotated[
        Literal["html", "pdf", "csv", "xlsx"] | None,
        typer.Option("--format", help="Format; that of --out's ending, or html, unless given."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; fieldlink-report.html (or .pdf, .xlsx) unless given."),
    ] = None,
    limit: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=100.0,
            help="Stick band that is too much, % of OP's span; the site's or 5 unless given.",
        ),
    ] = None,
    op_span: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            help="OP's span where no register map gives it; 100 unless given, or 1 of a "
            "recording whose OP lies between 0 and 1.",
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option(help="Seconds between rows of recordings.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the list as one JSON object.")
    ] = False,
) -> None:
    """Write the work list: what is wrong, what to do, by whom, and the evidence for each loop.

    CSV goes to the screen unless --out names a file (- is the screen). After an interruption the
    same command goes on with the recordings that are left.
    """
    from fieldlink.worklist import (
        AUDIENCES,
        PartialReport,
        WorkDocument,
        format_of,
        render,
        write_report,
    )

    to_screen = out == Path("-")
    if to_screen:
        out = None
    refuse_source(out, _read_files(sources))
    chosen = format_of(out, kind)
    if to_screen and chosen != "csv" and not as_json:
        raise typer.BadParameter(
            "only CSV and JSON go to the screen; add --format csv or --json, or name a file",
            param_hint="--out",
        )
    path = out or Path(f"fieldlink-report.{chosen}")
    partial = PartialReport(path) if out is not None or not (as_json or chosen == "csv") else None
    with show_work("reading") as say, closing(partial) if partial else nullcontext():
        title, loops = _loops(sources, limit, op_span, period, _steps(say), partial)
    document = WorkDocument(title, datetime.now(UTC), loops, AUDIENCES[audience])
    if as_json:
        typer.echo(json.dumps(document.to_dict(), allow_nan=False))
        if out is None:
            return
    elif chosen == "csv" and out is None:
        typer.echo(render(document, "csv").decode("utf-8").replace("\r\n", "\n"), nl=False)
        return
    with show_work(f"writing {path}"):
        write_report(document, path, chosen)
    if partial is not None:
        partial.remove()
    if not as_json:
        for sentence in document.summary:
            typer.echo(sentence)
        typer.echo(f"report: {path}")


def _loops(
    sources: Sequence[str],
    limit: float | None,
    op_span: float | None,
    period: float | None,
    progress: Progress,
    partial: PartialReport | None,
) -> tuple[str, list[ReportedLoop]]:
    """Return a title and the loops of what the user named."""
    from fieldlink.worklist import judge_recordings, list_loops

    stores = [source for source in sources if _is_site(source) or _is_store(source)]
    if stores and len(sources) > 1:
        raise typer.BadParameter(
            f"{stores[0]} stands for a whole fleet; name it alone, or name recordings only",
            param_hint="SITE|STORE|FILE...",
        )
    if stores and _is_site(stores[0]):
        from fieldlink.site import load_site

        site = load_site(stores[0])
        settings = _settings(limit or site.report.stick_band_limit, op_span)
        found = list_loops(site.historian_url, site, settings=settings, progress=progress)
        return f"Work list of {site.name}", found
    settings = _settings(limit, op_span)
    if stores:
        url = stores[0] if "://" in stores[0] else sqlite_url(stores[0])
        name = Path(stores[0].partition("://")[2] or stores[0]).stem
        found = list_loops(url, settings=settings, progress=progress)
        return f"Work list of {name}", found
    files = _recordings(sources)
    before = sum(partial.count(file, period) for file in files) if partial else 0
    if before:
        are = "loop is" if before == 1 else "loops are"
        typer.echo(f"going on with an earlier run: {before} {are} judged", err=True)
    workers = max(1, (os.cpu_count() or 1) - 1)
    found = judge_recordings(
        files,
        settings=settings,
        period=period,
        workers=workers,
        progress=progress,
        diagnose=partial_of(_finding, op_span=op_span),
        partial=partial,
    )
    what = as_text(files[0].name) if len(files) == 1 else f"{len(files)} recordings"
    return f"Work list of {what}", found


def _finding(_name: str, samples: WindowSamples, *, op_span: float | None = None) -> Finding | None:
    """Return what the diagnosis finds in a recording; None where the valve's verdict is enough.

    ``op_span`` is OP's span in its own units, None if not known.
    """
    from fieldlink.diagnosis import diagnose
    from fieldlink.worklist import finding_of_diagnosis

    if samples.stem is not None:
        return None
    found = diagnose(
        samples.op,
        samples.pv,
        samples.sp,
        auto=samples.auto,
        period=samples.period,
        advice=False,
        op_span=op_span,
    )
    return finding_of_diagnosis(found.to_dict()["causes"])


def _is_site(source: str) -> bool:
    return source.endswith(".toml")


def _is_store(source: str) -> bool:
    return "://" in source or source.endswith(_STORE_ENDINGS)


def _recordings(sources: Sequence[str]) -> list[Path]:
    """Return the files, those of a folder in the order of their names."""
    from fieldlink.site.recording import files_in

    files: list[Path] = []
    for source in sources:
        path = Path(source)
        inside = files_in(path)
        if not inside:
            raise typer.BadParameter(
                f"{source} is a folder without recordings; name files, or a site file",
                param_hint="SITE|STORE|FILE...",
            )
        files.extend(inside)
    return files


def _read_files(sources: Sequence[str]) -> list[Path]:
    """Return the files that a report reads, those of folders too, a site file and a store."""
    from fieldlink.site.recording import files_in

    return [file for source in sources if "://" not in source for file in files_in(Path(source))]


def _settings(limit: float | None, op_span: float | None) -> WorkListSettings:
    from fieldlink.worklist import WorkListSettings

    usual = WorkListSettings()
    return WorkListSettings(stick_band_limit=limit or usual.stick_band_limit, op_span=op_span)


def _steps(say: Callable[[str], None]) -> Progress:
    """Return what shows the loop that is read, and how many there are."""
    return lambda name, done, whole: say(f"{done + 1} of {whole}: {name}")
