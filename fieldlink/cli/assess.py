"""``fieldlink assess``: recorded loops of a whole site to one ranked table."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.time_arguments import parse_length, parse_moment
from fieldlink.one_window import LONGEST_WINDOW

if TYPE_CHECKING:
    from fieldlink.assess.assessment import Outcome
    from fieldlink.assess.run_file import Counts

__all__ = ["assess"]

ENGINES = ("local", "dask")

_ADDRESS = re.compile(r"(\w+://)?[^/\s]+:\d+/?")
"""A scheduler's: without a port its client fails late, and says a hundred lines."""

STOPPED = 130
"""The exit status of a command that Ctrl-C ended, as shells have it."""


def assess(
    places: Annotated[
        list[str],
        typer.Argument(
            help="Files (CSV, Excel, Parquet, .mat), folders of them, a site file or its "
            "historian, a database address, or a TOML file that describes a historian's SQL table.",
            metavar="PLACE...",
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Folder of the tables and the report; a stopped run goes on there.")
    ] = Path("fieldlink-assess"),
    since: Annotated[
        str | None, typer.Option(help="First moment, such as 2026-11-21; UTC without zone.")
    ] = None,
    until: Annotated[str | None, typer.Option(help="The moment after the last one.")] = None,
    every: Annotated[
        str | None,
        typer.Option(
            help="Begin a window every 1d, 8h or 30min; without it, windows follow each other."
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option(min=50, max=LONGEST_WINDOW, help="Samples of a window, at most.")
    ] = 1000,
    engine: Annotated[str, typer.Option(help="local or dask.")] = "local",
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://10.0.0.5:8786.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; one a core unless given.")
    ] = None,
    op: Annotated[str | None, typer.Option(help="Column of the controller output.")] = None,
    pv: Annotated[str | None, typer.Option(help="Column of the process variable.")] = None,
    sp: Annotated[str | None, typer.Option(help="Column of the set-point.")] = None,
    auto: Annotated[str | None, typer.Option(help="Column that is 1 while in automatic.")] = None,
    time: Annotated[str | None, typer.Option(help="Column of the time stamps.")] = None,
    period: Annotated[
        float | None, typer.Option(help="Sampling period in seconds; from the times unless given.")
    ] = None,
    criterion: Annotated[str, typer.Option(help="auto (coloured noise), oe or arx.")] = "auto",
    confidence: Annotated[float, typer.Option(help="Confidence of the intervals.")] = 0.9,
) -> None:
    """Judge every recorded window of every loop: loops.csv, loops.parquet and report.html.

    The exit status is 1 when some rows have an error. Ctrl-C keeps what is done; the same command
    goes on with the rest.
    """
    from fieldlink.assess.assessment import EngineChoice
    from fieldlink.assess.assessment import assess as run
    from fieldlink.assess.job import Columns, Cut, Job, Judging
    from fieldlink.assess.places import place_of
    from fieldlink.assess.table_files import require_parquet

    require_parquet()
    if engine not in ENGINES:
        raise typer.BadParameter(
            f"{engine!r} is unknown; write local or dask", param_hint="--engine"
        )
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise typer.BadParameter(
            f"{scheduler!r} is no address; write one such as tcp://10.0.0.5:8786",
            param_hint="--scheduler",
        )
    if period is not None and not period > 0.0:
        raise typer.BadParameter("must be positive", param_hint="--period")
    if not 0.5 <= confidence <= 0.999:
        raise typer.BadParameter("give a share from 0.5 to 0.999", param_hint="--confidence")
    if criterion not in ("auto", "oe", "arx"):
        raise typer.BadParameter(
            f"{criterion!r} is unknown; write auto, oe or arx", param_hint="--criterion"
        )
    first, after = parse_moment(since, "--since"), parse_moment(until, "--until")
    if first is not None and after is not None and first >= after:
        raise typer.BadParameter("must be after --since", param_hint="--until")
    job = Job(
        places=tuple(place_of(place) for place in places),
        columns=Columns(op, pv, sp, auto, time, period),
        cut=Cut(
            None if first is None else first.timestamp(),
            None if after is None else after.timestamp(),
            parse_length(every, "--every"),
            samples,
        ),
        judging=Judging(criterion, confidence),
    )
    # A scheduler is Dask's: naming one is choosing it.
    kind = "dask" if scheduler is not None else engine
    choice = EngineChoice(kind, workers or _cores(), scheduler)
    try:
        with _Shown() as shown:
            outcome = run(job, out, choice, shown)
    except KeyboardInterrupt:
        typer.echo(f"\nstopped; what is done is kept in {out}: the same command goes on", err=True)
        raise typer.Exit(STOPPED) from None
    _print(outcome, out)
    raise typer.Exit(1 if outcome.errors else 0)


def _cores() -> int:
    """The cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _print(outcome: Outcome, out: Path) -> None:
    from fieldlink.cli.tables import counted

    found = (
        f"{counted(outcome.loops, 'loop')}, {counted(outcome.rows, 'row')}, "
        f"{counted(outcome.errors, 'error')}"
    )
    if outcome.already:
        typer.echo(f"{out} was finished before: {found}; name another folder to judge it again")
        return
    if outcome.judged:
        found += f"; {outcome.judged} judged in {outcome.seconds:.0f} s"
    typer.echo(f"{out}: {found}")
    if outcome.outside:
        typer.echo(
            f"  nothing between --since and --until: {outcome.outside} files or parts of loops"
        )
    typer.echo("  loops.csv, loops.parquet: the ranked table; report.html: the same to read")
    typer.echo("  notes.csv: how files were read, where that is not plain")


class _Shown:
    """Progress on stderr: a bar on a terminal, elsewhere a line for each twentieth."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeRemainingColumn as Remaining

        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            Remaining(),
            TextColumn("{task.fields[found]}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("reading what is there", total=None, found="")
        self._quiet = console.is_terminal
        self._twentieth = -1

    def __enter__(self) -> _Shown:
        self._bar.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._bar.stop()

    def planned(self, pieces: int) -> None:
        """Show how many pieces were found."""
        self._bar.update(self._task, completed=pieces)

    def judged(self, counts: Counts, rows_per_second: float) -> None:
        """Show how far the run is."""
        from fieldlink.cli.tables import counted

        rows, errors = counted(counts.rows, "row"), counted(counts.errors, "error")
        found = f"{rows}, {errors}, {rows_per_second:.1f}/s"
        self._bar.update(
            self._task,
            description="judging",
            completed=counts.done,
            total=counts.pieces,
            found=found,
        )
        twentieth = 20 * counts.done // counts.pieces
        if not self._quiet and twentieth != self._twentieth:
            self._twentieth = twentieth
            print(f"{counts.done} of {counts.pieces} read: {found}", file=sys.stderr, flush=True)
