"""``fieldlink plant`` and ``fieldlink run``: the simulated PLC, and the daemon."""

from __future__ import annotations

import asyncio
import gc
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.site import SiteFile

if TYPE_CHECKING:
    from fieldlink.daemon import DaemonStatus
    from fieldlink.lab.plc import PlcServer
    from fieldlink.site import Site

__all__ = ["plant", "run"]

TRY_AGAIN = 75
"""Exit status of a daemon that may start later with nothing changed (EX_TEMPFAIL, sysexits.h)."""

Duration = Annotated[
    float | None, typer.Option(min=0.0, help="Seconds to run; without it until SIGTERM or SIGINT.")
]


def plant(
    site: SiteFile,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="TCP port instead of the site's; 0 picks a free one."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Plant seconds per second, instead of the site's.")
    ] = None,
    operator_switch: Annotated[
        bool,
        typer.Option(
            "--operator-switch",
            help="Let clients write the enable registers, as an operator's panel does.",
        ),
    ] = False,
    duration: Duration = None,
) -> None:
    """Serve the site's simulated loops as a Modbus PLC."""
    from fieldlink.daemon import configure_logging, stop_on_signals
    from fieldlink.lab.plc import check_plants, serve
    from fieldlink.site import load_site

    configure_logging()
    loaded = load_site(site)
    check_plants(loaded)
    typer.echo(
        "starting the plants; the first start on a machine compiles kernels for a minute or two",
        err=True,
    )
    if speed is not None and not speed > 0.0:
        raise typer.BadParameter("must be positive", param_hint="--speed")

    def ready(servers: Sequence[PlcServer]) -> None:
        for server in servers:
            for served in server.units:
                loops = ", ".join(served.plc.loops)
                typer.echo(
                    f"serving {served.plc.device} on {server.where} "
                    f"unit {served.unit}: {loops}; stop with Ctrl-C",
                )

    async def work() -> None:
        with stop_on_signals() as stop:
            if duration is not None:
                asyncio.get_running_loop().call_later(duration, stop.set)
            servers = await serve(
                loaded,
                port=port,
                speed=speed,
                operator_switch=operator_switch,
                ready=ready,
                stop=stop,
            )
        for server in servers:
            for served in server.units:
                typer.echo(
                    f"{served.plc.device}: {served.plc.scans} scans, {served.late} late; stopped"
                )

    asyncio.run(work())


def run(
    site: SiteFile,
    duration: Duration = None,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Never write to any device.")
    ] = False,
) -> None:
    """Run the daemon: poll, identify, store, and write back where the site file allows it.

    A site whose devices are simulations (link = "fmu") or recordings runs in lockstep, as fast as
    the machine can; --duration is then in plant seconds and needed for simulations.

    Status 2: the site file or the installation is wrong, and stays so. Status 75: what is around
    the daemon is not there yet, such as the database server; the next start may succeed.

    Otherwise SIGHUP, or a change of the site file or a register map, takes the new site over while
    running, and health and metrics are answered on the site's [web] address.
    """
    from fieldlink.cli.errors import explain
    from fieldlink.daemon import configure_logging
    from fieldlink.errors import FieldlinkError
    from fieldlink.site import load_site

    configure_logging()
    loaded = load_site(site)
    try:
        # A site has either kind alone.
        if all(loaded.devices[loop.device].is_stepped for loop in loaded.loops.values()):
            status = _lockstep(loaded, duration, read_only)
        else:
            status = asyncio.run(_live(loaded, duration, read_only))
    except FieldlinkError as error:
        if not error.may_pass:
            raise
        explain(error)
        raise SystemExit(TRY_AGAIN) from None
    _print(status)


async def _live(site: Site, duration: float | None, read_only: bool) -> DaemonStatus:
    from fieldlink.daemon import (
        Daemon,
        only_daemon,
        reload_on_hangup,
        stop_on_signals,
        supervised,
    )
    from fieldlink.opcua_server.serving import opcua_server
    from fieldlink.web import live_source, web_server

    with only_daemon(site.data_dir):
        # A second daemon is refused before it disturbs: its web port is the first one's, too.
        pass
    daemon = Daemon(site, read_only=read_only, watch_files=True)
    with stop_on_signals() as stop, reload_on_hangup(daemon.reload_soon):
        async with (
            live_source(daemon) as source,
            web_server(site, daemon, source),
            opcua_server(site, daemon, source),
            supervised(daemon),
        ):
            # What is loaded by now stays to the end. Looking through it for garbage again and again
            # would hold up every poll for tens of milliseconds.
            gc.collect()
            gc.freeze()
            return await daemon.run(duration, stop)


def _lockstep(site: Site, duration: float | None, read_only: bool) -> DaemonStatus:
    import signal

    from fieldlink.daemon import LockstepRun, stop_on_signals
    from fieldlink.lab.plc import check_plants

    check_plants(site)
    endless = any(site.devices[loop.device].link == "fmu" for loop in site.loops.values())
    if duration is None and endless:
        raise typer.BadParameter(
            "a simulated plant has no end of its own; give the plant seconds to run",
            param_hint="--duration",
        )
    seconds = float("inf") if duration is None else duration
    # Without reloads, the end of the terminal is the end of the run.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

    async def work() -> DaemonStatus:
        run = LockstepRun(site, store=True, read_only=read_only, start_utc=time.time())
        with stop_on_signals() as stop:
            return await run.run(seconds, stop=stop)

    return asyncio.run(work())


def _print(status: DaemonStatus) -> None:
    from fieldlink.cli.tables import counted

    for name, device in status.devices.items():
        typer.echo(
            f"device {name}: {device.state.name.lower()}, {device.polls} polls, "
            f"{device.late} skipped, {device.requests} requests, {device.failures} failures, "
            f"{counted(device.connects, 'connection')}, "
            f"{device.late_replies} late replies passed over"
        )
        if device.quarantined:
            typer.echo(f"  refused by the device: {', '.join(device.quarantined)}")
    for name, loop in status.loops.items():
        counts = loop.counts
        typer.echo(
            f"loop {name}: {counts.read} samples read, {counts.bad} bad, {counts.missed} missed; "
            f"{counted(loop.estimates, 'estimate')}, "
            f"{counted(loop.attempts, 'write-back decision')}"
        )
        if loop.last_estimate is not None and (found := loop.last_estimate.findings) is not None:
            S, J = found.stick_band, found.slip_jump
            # The S of another verdict is that of a valve that the window does not confirm.
            sizes = (
                f": S {S.value:.4g} [{S.low:.4g}, {S.high:.4g}], "
                f"J {J.value:.4g} [{J.low:.4g}, {J.high:.4g}]"
            )
            confirmed = found.verdict == "stiction"
            typer.echo(f"  {found.verdict}, score {found.score:.2f}{sizes if confirmed else ''}")
        if loop.last_attempt is not None:
            attempt = loop.last_attempt
            typer.echo(f"  write-back: {attempt.outcome.code}, {attempt.outcome.advice}")
    typer.echo(f"stored {status.store.written} records, lost {status.store.dropped}")
