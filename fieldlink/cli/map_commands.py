"""``fieldlink map import`` and ``fieldlink map export``: register maps from and for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from fieldlink.cli.outputs import refuse_source, refuse_to_replace
from fieldlink.cli.site import SiteFile

__all__ = ["app", "parse_headings"]

app = typer.Typer(no_args_is_help=True, help="Register maps: from a vendor's list, to a file.")

Out = Annotated[
    Path | None, typer.Option("--out", help="File to write (.csv or .xlsx); else it is printed.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(help="A list of registers: .csv or .xlsx.")],
    out: Out = None,
    addresses: Annotated[
        Literal["zero", "one", "modicon", "hex"] | None,
        typer.Option(help="How addresses are written; recognised unless given."),
    ] = None,
    sheet: Annotated[
        str | None, typer.Option(help="Sheet of a workbook; the first unless given.")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=HEADING",
            help="The list's heading of a register map's column, such as tag=Typ.",
        ),
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Write the good rows although others are bad.")
    ] = False,
    force: Force = False,
) -> None:
    """Turn a vendor's list into a register map, with a report of every bad row."""
    from fieldlink.cli.tables import counted, data_console, labelled
    from fieldlink.printable import as_printable
    from fieldlink.site.map_export import map_as_csv, write_map
    from fieldlink.site.map_import import import_map

    refuse_source(out, [file])
    refuse_to_replace(out, force=force)
    found = import_map(
        file, addresses=addresses, sheet=sheet, headings=parse_headings(column or [])
    )
    console = data_console(stderr=True, highlight=False, soft_wrap=True)
    for note in found.notes:
        console.print(f"  {as_printable(note)}")
    for problem in found.problems:
        console.print(labelled("bad row", str(problem), "red"))
    console.print(
        f"{counted(found.rows, 'row')}, {counted(len(found.tags), 'tag')}, "
        f"{counted(found.bad_rows, 'bad row')}",
        style="bold",
    )
    if found.problems and not skip_bad:
        console.print("nothing is written; correct the rows, or leave them out with --skip-bad")
        raise typer.Exit(2)
    if out is None:
        typer.echo(map_as_csv(found.tags.values()), nl=False)
    else:
        write_map(found.tags.values(), out)
        console.print(f"written to {out}")


def parse_headings(pairs: list[str]) -> dict[str, str]:
    """Return column to heading of ``tag=Typ``."""
    found: dict[str, str] = {}
    for pair in pairs:
        column, equals, heading = pair.partition("=")
        if not (equals and column.strip() and heading.strip()):
            raise typer.BadParameter(
                f"{pair!r} is not COLUMN=HEADING, such as tag=Typ", param_hint="--column"
            )
        if column.strip() in found:
            raise typer.BadParameter(f"{column.strip()} is given twice", param_hint="--column")
        found[column.strip()] = heading.strip()
    return found


@app.command("export")
def export(
    site: SiteFile,
    device: Annotated[
        str | None, typer.Argument(help="Device of the site; needed where it has several.")
    ] = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """Write the register map of a device with every column in the program's own words."""
    from fieldlink.site import load_site
    from fieldlink.site.map_export import map_as_csv, write_map

    maps = load_site(site).maps
    if device is None and len(maps) == 1:
        device = next(iter(maps))
    if device is None or device not in maps:
        known = ", ".join(maps) or "none"
        raise typer.BadParameter(f"devices with a register map: {known}", param_hint="DEVICE")
    refuse_to_replace(out, force=force)
    tags = maps[device].values()
    if out is None:
        typer.echo(map_as_csv(tags), nl=False)
    else:
        write_map(tags, out)
        typer.echo(f"{len(tags)} tags written to {out}")
