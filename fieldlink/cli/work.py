"""``fieldlink work``: who does what about a loop, and how far it is."""

from __future__ import annotations

import getpass
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

import typer

from fieldlink.cli.site import SiteFile

__all__ = ["work"]


def work(
    site: SiteFile,
    loop: Annotated[
        str | None, typer.Argument(metavar="LOOP", help="Name of the loop; all unless given.")
    ] = None,
    state: Annotated[
        Literal["open", "planned", "done", "verified"] | None,
        typer.Option(
            help="How far the work is; done marks the repair from which trends start again."
        ),
    ] = None,
    owner: Annotated[str | None, typer.Option(help="Who does it; empty for nobody.")] = None,
    note: Annotated[str | None, typer.Option(help="Note to keep.")] = None,
    at: Annotated[
        str | None,
        typer.Option(
            help="When it was, such as 2026-03-12 or 2026-03-12T06:00+01:00; UTC where no offset "
            "is given; now without."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Set or show the work on a loop: state, owner, note. Reports show the newest.

    Without state, owner and note the history is printed.
    """
    from fieldlink.cli.time_arguments import parse_moment
    from fieldlink.site import load_site
    from fieldlink.store import FleetReader, record_work

    loaded = load_site(site)
    if loop is not None and loop not in loaded.loops:
        from fieldlink.site.errors import nearest

        raise typer.BadParameter(
            f"the site file has no loop {loop!r}; {nearest(loop, loaded.loops)}", param_hint="LOOP"
        )
    with FleetReader(loaded.historian_url) as store:
        said = store.work()
    if state is None and owner is None and note is None:
        _show([row for row in said if loop in (None, row["loop"])], as_json=as_json)
        return
    if loop is None:
        raise typer.BadParameter("name the loop whose work is set", param_hint="LOOP")
    last = next((row for row in reversed(said) if row["loop"] == loop), None)
    moment = parse_moment(at, "--at")
    if moment is not None and moment > datetime.now(UTC):
        raise typer.BadParameter(f"{at} is in the future; plan with --note", param_hint="--at")
    record = record_work(
        loaded.historian_url,
        loop,
        state or ("open" if last is None else last["state"]),
        owner=owner if owner is not None else "" if last is None else last["owner"],
        note=note if note is not None else "" if last is None else last["note"],
        author=_author(),
        utc_ms=None if moment is None else round(1000.0 * moment.timestamp()),
    )
    if as_json:
        typer.echo(json.dumps(record.row()))
    else:
        typer.echo(f"{loop}: {record.state}, owner {record.owner or 'nobody'}")


def _show(said: Sequence[Mapping[str, Any]], *, as_json: bool) -> None:
    from fieldlink.printable import as_printable

    rows = [{**row, "time": row["time"].isoformat(timespec="seconds")} for row in said]
    if as_json:
        typer.echo(json.dumps(rows))
        return
    for row in rows:
        words = (row["time"], row["loop"], row["state"], row["owner"] or "nobody", row["note"])
        typer.echo(as_printable("  ".join(map(str, words))))
    if not rows:
        typer.echo("nothing is recorded yet; set it with --state planned --owner NAME")


def _author() -> str:
    """The user of this command; empty where the system knows none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return ""
