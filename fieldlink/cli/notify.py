"""``fieldlink notify``: whether notices reach people."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.site import SiteFile

if TYPE_CHECKING:
    from fieldlink.notices import Notice, Receiver

__all__ = ["app"]

app = typer.Typer(
    help="Notices of findings and lost devices: try the receivers of a site.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


@app.callback()
def _group() -> None:
    """Make ``test`` the name of a command: Typer drops the name of an only command."""


@app.command("test")
def send_test(
    site: SiteFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Send a test notice to every receiver of the site file; exit status 1 if one fails.

    It is sent at once, does not count for per_hour, and needs no running daemon.
    """
    from fieldlink.notices import probe_notice, receivers_of
    from fieldlink.printable import as_printable
    from fieldlink.site import load_site

    loaded = load_site(site)
    notify = loaded.file.notify
    if notify is None:
        raise typer.BadParameter(
            f"{site} has no table [notify]; add it with a web_hook or mail", param_hint="SITE"
        )
    receivers = receivers_of(loaded)
    notice = probe_notice(loaded.name, notify.page, round(1000.0 * time.time()))
    problems = asyncio.run(_send_all(receivers, notice))
    if as_json:
        rows = [
            {"receiver": name, "where": one.where, "delivered": not problem, "problem": problem}
            for (name, one), problem in zip(receivers.items(), problems, strict=True)
        ]
        typer.echo(json.dumps(rows))
    else:
        for (name, one), problem in zip(receivers.items(), problems, strict=True):
            said = problem or f"taken by {one.where}"
            typer.echo(as_printable(f"{name}: {said}"))
    if any(problems):
        raise typer.Exit(1)


async def _send_all(receivers: Mapping[str, Receiver], notice: Notice) -> list[str]:
    """Send to all at once; what is wrong with each, empty where all of it was taken."""

    async def send(receiver: Receiver) -> str:
        from fieldlink.notices import NoticeError

        try:
            return await receiver.send(notice)
        except NoticeError as error:
            return str(error)

    return list(await asyncio.gather(*map(send, receivers.values())))
