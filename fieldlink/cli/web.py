"""``fieldlink web``: the pages of a store, without a daemon."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["web"]

PORT = 9481
"""Beside the daemon's own."""


def web(
    store: Annotated[
        str,
        typer.Argument(
            help="A site file, an SQLite file, or a database address.", metavar="SITE|STORE"
        ),
    ],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="TCP port; 0 picks a free one.")
    ] = PORT,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="Seconds to serve; without it until Ctrl-C.")
    ] = None,
) -> None:
    """Serve the pages of a store in a browser, read-only and without a daemon."""
    from fieldlink.daemon import configure_logging, stop_on_signals
    from fieldlink.site import load_site
    from fieldlink.sqlite_url import sqlite_url
    from fieldlink.web import store_server

    configure_logging()
    site = load_site(Path(store)) if store.endswith(".toml") else None
    if site is not None:
        url = site.historian_url
    else:
        url = store if "://" in store else sqlite_url(Path(store).absolute())

    async def work() -> None:
        with stop_on_signals() as stop:
            async with store_server(url, site, host, port) as address:
                typer.echo(f"page: {address}")
                try:
                    async with asyncio.timeout(duration):
                        await stop.wait()
                except TimeoutError:
                    return

    asyncio.run(work())
