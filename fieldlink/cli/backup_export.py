"""``fieldlink backup`` and ``fieldlink export``: copies of what the historian holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fieldlink.cli.outputs import refuse_folder
from fieldlink.cli.progress import show_work
from fieldlink.cli.site import SiteFile
from fieldlink.cli.time_arguments import parse_moment

__all__ = ["backup", "export"]

Force = Annotated[bool, typer.Option("--force", help="Replace a file that exists.")]


def backup(
    site: SiteFile,
    out: Annotated[Path, typer.Argument(help="The new file.", metavar="FILE")],
    force: Force = False,
) -> None:
    """Copy the historian as it is at one moment, while the daemon goes on writing."""
    from fieldlink.site import load_site
    from fieldlink.store import back_up

    refuse_folder(out, "FILE")
    url = load_site(site).historian_url
    with show_work(f"copying to {out}"):
        made = back_up(url, out, overwrite=force)
    typer.echo(f"{made.file}: {made.bytes / 1e6:.1f} MB, {made.samples} samples; checked")


def export(
    site: SiteFile,
    out: Annotated[Path, typer.Option(help="The new file, .csv or .parquet.")],
    loop: Annotated[str | None, typer.Option(help="Only this loop; all unless given.")] = None,
    since: Annotated[
        str | None,
        typer.Option("--from", help="First moment, such as 2026-11-21 or 2026-11-21T06:00+01:00."),
    ] = None,
    until: Annotated[
        str | None, typer.Option("--to", help="Last moment; UTC without zone.")
    ] = None,
    table: Annotated[
        str,
        typer.Option(
            help="samples, averages, slots, estimates, writebacks, events, work, diagnoses or "
            "findings."
        ),
    ] = "samples",
    force: Force = False,
) -> None:
    """Write a table of the historian to a CSV or Parquet file."""
    from fieldlink.site import load_site
    from fieldlink.store import export as write

    refuse_folder(out)
    loaded = load_site(site)
    if loop is not None and loop not in loaded.loops:
        known = ", ".join(loaded.loops)
        typer.secho(
            f"fieldlink: the site file has no loop {loop!r} (it has {known}); looking for what "
            "the historian has of it",
            err=True,
        )
    begin, end = parse_moment(since, "--from"), parse_moment(until, "--to")
    with show_work(f"writing {out}"):
        made = write(
            loaded.historian_url,
            out,
            table=table,
            loop=loop,
            since=begin,
            until=end,
            overwrite=force,
        )
    typer.echo(f"{made.file}: {made.rows} rows of {table}")
