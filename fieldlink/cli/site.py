"""``fieldlink check`` and ``fieldlink schema``: what a site file means, and what it may hold."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from fieldlink.site import CheckReport, Site
    from fieldlink.site.check_report import DeviceReport, LoopReport, RequestReport

__all__ = ["SiteFile", "check", "schema"]

SiteFile = Annotated[Path, typer.Argument(help="The site file (TOML).", metavar="SITE")]


def check(
    site: SiteFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Print what a site file means and which requests a scan takes; nothing is contacted."""
    from rich.console import Console

    from fieldlink.site import check as report_on
    from fieldlink.site import load_site

    loaded = load_site(site)
    further = (*_check_plants(loaded), *_check_broker(loaded))
    report = report_on(loaded)
    report = replace(report, warnings=(*report.warnings, *further))
    if as_json:
        typer.echo(json.dumps(report.to_dict()))
        return
    # Names are data: what looks like markup in one is printed as it is.
    _print(Console(soft_wrap=True, highlight=False, markup=False), report)


def _check_plants(site: Site) -> tuple[str, ...]:
    """Check the FMUs of a site; return a warning where this installation cannot.

    Raises:
        SiteError: an FMU, a variable, a parameter or a controller is wrong.
    """
    names = [name for name, loop in site.loops.items() if loop.plant and loop.plant.fmu]
    if not names:
        return ()
    if find_spec("fmpy") is None:
        return (
            f"loop {names[0]}: plants with an fmu are not checked here; that takes "
            "pip install 'fieldlink[lab]'",
        )
    from fieldlink.lab.plc import check_plants

    check_plants(site)
    return ()


def _check_broker(site: Site) -> tuple[str, ...]:
    """Return a warning where the files of the broker's password or certificates are of no use.

    The daemon runs all the same, and keeps what it would publish.
    """
    if site.file.mqtt is None:
        return ()
    from fieldlink.upward import UpwardError
    from fieldlink.upward.broker_settings import BrokerSettings

    try:
        BrokerSettings.of_site(site, "check")
    except UpwardError as error:
        return (f"nothing can be published: {error}",)
    return ()


def schema() -> None:
    """Print the JSON Schema of the site file, for an editor that completes and checks."""
    from fieldlink.site import schema as json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


def _print(console: Console, report: CheckReport) -> None:
    from fieldlink.cli.tables import counted

    _print_line(console, (f"site {report.name}", "bold"), f"  {report.file}")
    _print_line(console, f"  data in {report.data_dir}; historian {report.historian}")
    for device in report.devices:
        _print_device(console, device)
    for loop in report.loops:
        _print_loop(console, loop)
    for name, said in (("mqtt", report.upward), ("opcua_server", report.opcua_server)):
        if said:
            console.print()
            _print_line(console, (name, "bold"), f"  {said}")
    for warning in report.warnings:
        _print_line(console, ("warning", "yellow"), f" {warning}")
    counts = (
        (len(report.devices), "device"),
        (len(report.loops), "loop"),
        (report.requests_per_scan, "request"),
        (len(report.warnings), "warning"),
    )
    devices, loops, requests, warnings = (counted(*pair) for pair in counts)
    console.print()
    _print_line(console, ("ok", "green"), f" {devices}, {loops}, {requests} per scan, {warnings}")


def _print_line(console: Console, *parts: str | tuple[str, str]) -> None:
    """Print text, some of it in a style, on one line that no part of it can leave."""
    from rich.text import Text

    from fieldlink.printable import as_printable

    pairs = [(part, "") if isinstance(part, str) else part for part in parts]
    # Blanks at the ends are ours: they indent.
    cleaned = [(part if part.isprintable() else as_printable(part), style) for part, style in pairs]
    console.print(Text.assemble(*cleaned))


def _print_device(console: Console, device: DeviceReport) -> None:
    from fieldlink.cli.tables import counted

    where = f" {device.address}" if device.address else ""
    console.print()
    _print_line(console, (f"device {device.name}", "bold"), f"  {device.link}{where}")
    order = f"byte order {device.order}, " if device.order else ""
    _print_line(
        console,
        f"  {counted(device.tags, 'tag')}, {order}"
        f"{counted(len(device.requests), 'request')} per scan",
    )
    for request in device.requests:
        kind = f"FC{request.function}" if request.function else "Read"
        _print_line(
            console,
            f"  {kind} {request.table} {request.first}-{request.last}: "
            f"{', '.join(request.tags)}{_rate(request)}",
        )


def _rate(request: RequestReport) -> str:
    if request.every:
        return f"; every {request.every:g} s"
    return f"; in one scan of {request.polls}" if request.polls > 1 else ""


def _print_loop(console: Console, loop: LoopReport) -> None:
    console.print()
    _print_line(console, (f"loop {loop.name}", "bold"), f"  on {loop.device}")
    _print_line(console, "  " + ", ".join(f"{role} {tag}" for role, tag in loop.tags.items()))
    together = {
        True: "OP and PV come from one request",
        False: "OP and PV do NOT come from one request",
        None: "no register map",
    }[loop.op_pv_together]
    _print_line(
        console,
        f"  every {loop.period:g} s, {together}; window {loop.window_seconds:g} s, "
        f"estimated every {loop.estimate_every:g} s",
    )
    back = loop.writeback
    if back is None:
        _print_line(console, "  write-back: none")
    else:
        areas = ", ".join(
            f"{name} {first}" + (f"-{last}" if last != first else "")
            for name, first, last in back.areas
        )
        state = "enabled" if back.enabled else "disabled"
        _print_line(console, f"  write-back: {state}, loop id {back.loop_id}; {areas}")
    if loop.plant:
        _print_line(console, f"  simulated by: {loop.plant}")
