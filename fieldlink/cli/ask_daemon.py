"""``fieldlink status``, ``events`` and ``withdraw``: what a daemon does, and one thing to ask."""

from __future__ import annotations

import asyncio
import json
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from types import FrameType
from typing import Annotated, Any

import typer

from fieldlink.cli.site import SiteFile

__all__ = ["events", "status", "withdraw"]

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]

FOLLOW_EVERY = 0.5
"""Seconds between two looks at the store while events are followed."""


def status(
    site: SiteFile,
    as_json: Json = False,
    must_run: Annotated[
        bool,
        typer.Option("--must-run", help="End with status 1 when no daemon runs: a health check."),
    ] = False,
) -> None:
    """Show devices, loops, blocks and what waits: of the running daemon, or from the store."""
    from fieldlink.daemon.installation import is_in_use
    from fieldlink.daemon.reporting.control_socket import ask_daemon
    from fieldlink.daemon.reporting.status_documents import stored_status
    from fieldlink.site import load_site

    loaded = load_site(site)
    if is_in_use(loaded.data_dir):
        found = ask_daemon(loaded.data_dir, {"command": "status"})
    else:
        found = stored_status(loaded)
    if as_json:
        typer.echo(json.dumps(found))
    else:
        tags = {name: loaded.tag(name, "op") for name in loaded.loops}
        for line in _lines(found, {name: tag.unit for name, tag in tags.items() if tag}):
            typer.echo(line)
    if must_run and not is_in_use(loaded.data_dir):
        typer.echo("no daemon runs for this site", err=True)
        raise typer.Exit(1)


def events(
    site: SiteFile,
    as_json: Json = False,
    follow: Annotated[bool, typer.Option("--follow", help="Keep printing new events.")] = False,
    last: Annotated[int, typer.Option(min=0, help="Show at most this many of the newest.")] = 100,
) -> None:
    """Show what happened to the daemon, its devices, loops and store, oldest first."""
    from fieldlink.daemon.reporting.status_documents import event_document
    from fieldlink.site import load_site
    from fieldlink.store import EventStream

    stream = EventStream(load_site(site).historian_url)
    with _interrupted() if follow else nullcontext() as stop:
        found = stream.begin(last)
        while True:
            for event in found:
                document = event_document(event)
                typer.echo(json.dumps(document) if as_json else _event_line(document))
            if stop is None:
                return
            if stop.wait(FOLLOW_EVERY):
                raise typer.Exit(130)
            found = stream.follow()


@contextmanager
def _interrupted() -> Iterator[threading.Event]:
    """Give what Ctrl-C sets while the block runs; a second one interrupts at once.

    An exception would be lost where it comes while SQLAlchemy clears a connection away (in a weak
    reference's callback): the program would go on, behind a traceback.
    """
    stop = threading.Event()
    before = signal.getsignal(signal.SIGINT)

    def end(_number: int, _frame: FrameType | None) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)

    if before is not signal.SIG_IGN:  # a shell's job in the background is not meant
        signal.signal(signal.SIGINT, end)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def withdraw(
    site: SiteFile,
    loop: Annotated[str, typer.Argument(help="The loop.", metavar="LOOP")],
    reason: Annotated[str, typer.Option("--reason", help="Why, for the record.")],
) -> None:
    """Withdraw a loop's parameter block: the PLC falls back to its own controller.

    No block follows until an operator clears the PLC's enable bit and sets it again.
    """
    from fieldlink.daemon.installation import is_in_use
    from fieldlink.daemon.operators.withdrawal import withdraw_without_daemon
    from fieldlink.daemon.reporting.control_socket import ask_daemon
    from fieldlink.site import load_site

    loaded = load_site(site)
    if loop not in loaded.loops:
        raise typer.BadParameter(
            f"the site file has no loop {loop!r}; it has {', '.join(loaded.loops)}",
            param_hint="LOOP",
        )
    if not reason.strip():
        raise typer.BadParameter("say why, for the record", param_hint="--reason")
    if is_in_use(loaded.data_dir):
        ask_daemon(loaded.data_dir, {"command": "withdraw", "loop": loop, "reason": reason})
        typer.echo(f"{loop}: asked the running daemon; fieldlink status shows when it is done")
        return
    found = asyncio.run(withdraw_without_daemon(loaded, loop, reason))
    typer.echo(f"{loop}: {found}")


def _event_line(document: dict[str, Any]) -> str:
    words = (document[key] for key in ("time", "event", "source", "message"))
    return "  ".join(_printable(str(word)) for word in words)


def _lines(found: dict[str, Any], units: Mapping[str, str]) -> list[str]:
    from fieldlink.cli.tables import counted

    daemon = found["daemon"]
    state = "running since" if daemon["alive"] else "not running; last seen"
    lines = [f"daemon {state} {daemon['since']}", *_store_lines(found.get("store"))]
    for device in found["devices"]:
        own = f"device {device['name']}: "
        reason = f"; {device['reason'].removeprefix(own)}" if device["reason"] else ""
        # The store keeps counts of samples; those of requests and polls a running daemon has.
        counts = (
            f"{counted(device['late'], 'late sample')}, "
            if device["requests"] is None
            else f"{counted(device['requests'], 'request')}, "
            f"{counted(device['exceptions'], 'failure')}, "
            f"{counted(device['late'], 'skipped poll')}, "
        )
        lines.append(f"{own}{device['state']}, {counts}{device['missed']} missed{reason}")
    for loop in found["loops"]:
        block = loop["block"]
        # A run in lockstep stores no counts of samples.
        samples = (
            f"{loop['read']} of {loop['expected']} samples, {loop['bad']} bad, "
            f"{loop['missed']} missed; "
        )
        lines.append(
            f"loop {loop['name']}: {samples if loop['expected'] else ''}"
            f"{loop['verdict'] or _no_verdict(loop)}"
            # The S of another verdict is that of a valve that the window does not confirm.
            + (_stick_band(loop, units.get(loop["name"], "")) if _is_sticky(loop) else "")
            + (f"; cause: {loop['cause'].replace('_', ' ')}" if loop.get("cause") else "")
        )
        if loop["fault"]:
            lines.append(f"  bad: {loop['fault']}")
        if block["seq"] is not None:
            reason = f"; {block['reason']}" if block["reason"] else ""
            lines.append(f"  block {block['seq']}: {block['status']}{reason}")
        elif block["reason"]:
            lines.append(f"  no block; {block['reason']}")
        if loop["waiting"] is not None:
            lines.append(f"  waits: {loop['waiting']}")
    for finding in found.get("findings", []):
        lines.append(f"finding {finding['finding']} ({finding['state']}): {finding['text']}")
    return [_printable(line) for line in lines]


def _store_lines(store: dict[str, Any] | None) -> Iterator[str]:
    """Yield what is wrong with the store; only a running daemon of this release tells it."""
    from fieldlink.cli.tables import counted

    if store is not None and store["failing"]:
        waiting = counted(store["waiting"], "record")
        yield f"store: cannot be written: {store['reason']}; {waiting} waiting in memory"
    if store is not None and store["lost"]:
        yield f"store: {counted(store['lost'], 'record')} lost"


def _no_verdict(loop: dict[str, Any]) -> str:
    # Only a running daemon has a window.
    filled = loop.get("filled")
    if filled is not None and filled >= 1.0 and loop.get("estimates") == 0:
        return (
            "no estimate yet, window full and being judged (the first time after an installation "
            "that takes minutes)"
        )
    return "no estimate yet" + ("" if filled is None else f", window {filled:.0%} full")


def _stick_band(loop: dict[str, Any], unit: str) -> str:
    low, high = loop.get("stick_band_low"), loop.get("stick_band_high")
    # A daemon of an earlier release tells no interval.
    between = "" if low is None or high is None else f" ({low:.4g} to {high:.4g})"
    return f", S = {loop['stick_band']:.4g}{between} {unit or 'in units of OP'}".rstrip()


def _is_sticky(loop: dict[str, Any]) -> bool:
    return loop["verdict"] == "stiction" and loop["stick_band"] is not None


def _printable(text: str) -> str:
    """A name from a file must not command the terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)
