"""``fieldlink service``: the systemd unit of a site, shown or installed."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.site import SiteFile

if TYPE_CHECKING:
    from fieldlink.systemd import ServiceUnit

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="Run a site as a systemd service.")

ForUser = Annotated[
    bool, typer.Option("--user", help="A unit of your own, without root and without its limits.")
]
RunAs = Annotated[str, typer.Option(help="The account that a system's unit runs under.")]
Name = Annotated[str | None, typer.Option(help="Name of the service; fieldlink-SITE unless given.")]


@app.command("show")
def show(
    site: SiteFile, for_user: ForUser = False, run_as: RunAs = "fieldlink", name: Name = None
) -> None:
    """Print the unit of a site; nothing is written."""
    typer.echo(_unit(site, for_user=for_user, run_as=run_as, name=name).text, nl=False)


@app.command("install")
def install(
    site: SiteFile,
    for_user: ForUser = False,
    run_as: RunAs = "fieldlink",
    name: Name = None,
    folder: Annotated[
        Path | None,
        typer.Option(help="Folder of the unit; /etc/systemd/system, or the user's own."),
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace a unit of this name that differs.")
    ] = False,
) -> None:
    """Write the unit of a site where systemd finds it, and print what to type next.

    The site is checked first. Nothing is started, and a unit that is there is never overwritten
    silently.
    """
    from fieldlink.printable import as_printable
    from fieldlink.systemd.installing import install_unit, next_commands, unit_folder

    unit = _unit(site, for_user=for_user, run_as=run_as, name=name)
    done = install_unit(unit, folder or unit_folder(for_user=for_user), replace=replace)
    typer.echo(f"{done.outcome.value}: {as_printable(str(done.file))}")
    typer.echo(f"  site file  {as_printable(str(site.absolute()))}")
    typer.echo(f"  data       {as_printable(str(unit.data_dir))}")
    typer.echo(f"  runs as    {unit.user or 'you'}")
    typer.echo("next:")
    for command in next_commands(unit, site.absolute()):
        typer.echo(f"  {as_printable(command)}")


def _unit(site: Path, *, for_user: bool, run_as: str, name: str | None) -> ServiceUnit:
    from fieldlink.site import load_site
    from fieldlink.systemd import unit_of

    return unit_of(
        load_site(site),
        program=_program(),
        user=None if for_user else run_as,
        name=name,
        python=Path(sys.base_prefix),
    )


def _program() -> Path:
    """Return the executable of this installation: that beside its Python, or in the path."""
    beside = Path(sys.executable).with_name("fieldlink")
    found = shutil.which("fieldlink")
    return beside if beside.is_file() or found is None else Path(found)
