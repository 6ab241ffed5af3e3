"""``fieldlink --version`` and ``fieldlink support-bundle``: what a report of a defect needs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fieldlink.cli.outputs import refuse_folder

__all__ = ["show_options", "support_bundle"]


def _print_versions(wanted: bool) -> None:
    if not wanted:
        return
    from fieldlink.versions import find_versions

    for name, version in find_versions().items():
        typer.echo(f"{name} {version}")
    raise typer.Exit


def show_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_print_versions,
            help="Print the versions of fieldlink, Python and the packages it computes with.",
        ),
    ] = False,
) -> None:
    """Hold the options that stand before a command."""


def support_bundle(
    site: Annotated[
        Path | None,
        typer.Argument(help="The site file (TOML); versions alone without it.", metavar="SITE"),
    ] = None,
    out: Annotated[Path, typer.Option(help="The new file.", metavar="FILE.zip")] = Path(
        "fieldlink-support.zip"
    ),
) -> None:
    """Write a ZIP file for a report of a defect: configuration without secrets, versions, events.

    It holds host names, tags and event texts. Passwords and tokens are cut out and files with keys
    are not opened. Look through it before you send it.
    """
    from fieldlink.daemon.reporting.support_bundle import write_bundle

    refuse_folder(out)
    parts = write_bundle(site, out)
    typer.echo(f"{out}: {', '.join(parts)}")
    if missing := [part for part in parts if part.endswith(".missing.txt")]:
        typer.echo(f"why parts are missing is in {', '.join(missing)}")
