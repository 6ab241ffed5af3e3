"""``fieldlink scan``, ``read`` and ``write``: looking at a device, and single values by hand."""

from __future__ import annotations

import asyncio
import json
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.target import (
    Baud,
    Ca,
    Cert,
    DeviceName,
    Framing,
    Key,
    Parity,
    ServerName,
    StopBits,
    Target,
    TargetArgument,
    Timeout,
    Unit,
    find_target,
)

if TYPE_CHECKING:
    from fieldlink.links import Reading
    from fieldlink.links.by_hand import Point
    from fieldlink.links.survey import Survey
    from fieldlink.registers import Table

__all__ = ["read", "scan", "write"]

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object only.")]


def scan(
    target: TargetArgument,
    units: Annotated[
        str, typer.Option(help="Unit ids to try, such as 1,5,10-20; for a site the device's own.")
    ] = "",
    tables: Annotated[
        str, typer.Option(help="Tables to look at, such as holding,input; all four.")
    ] = "",
    first: Annotated[int, typer.Option(min=0, max=65535, help="First address.")] = 0,
    last: Annotated[int, typer.Option(min=0, max=65535, help="Last address.")] = 499,
    block: Annotated[int, typer.Option(min=1, max=125, help="Addresses asked for at once.")] = 100,
    pause: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Seconds between two requests.")
    ] = 0.02,
    max_requests: Annotated[int, typer.Option(min=1, help="Most requests in all.")] = 2000,
    device: DeviceName = None,
    transport: Framing = "tcp",
    baud: Baud = 19200,
    parity: Parity = "even",
    stop_bits: StopBits = 1,
    timeout: Timeout = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
    server_name: ServerName = None,
    as_json: AsJson = False,
) -> None:
    """Find out which unit ids answer and which addresses can be read; nothing is written."""
    from rich.console import Console

    from fieldlink.links.survey import SurveySettings, survey

    if last < first:
        raise typer.BadParameter(f"{last} is before --first {first}", param_hint="--last")
    found = find_target(
        target,
        device=device,
        transport=transport,
        baud=baud,
        parity=parity,
        stop_bits=stop_bits,
        timeout=timeout,
        ca=ca,
        cert=cert,
        key=key,
        server_name=server_name,
    )
    if found.device.is_opcua:
        raise typer.BadParameter(
            f"{found.name} is an OPC UA server, scan looks at Modbus devices; browse it with an "
            "OPC UA client and name its nodes in the node map",
            param_hint="TARGET",
        )
    settings = SurveySettings(
        units=_unit_ids(units) or ((found.device.unit,) if found.site else _usual_units(found)),
        tables=_tables(tables),
        first=first,
        last=last,
        block=block,
        pause=pause,
        max_requests=max_requests,
    )
    errors = Console(stderr=True, highlight=False)
    with errors.status("looking") as status:

        def progress(what: str, requests: int) -> None:
            status.update(f"{what}, {requests} requests")

        result = asyncio.run(survey(found.device, settings, progress, found.resolve))
    if as_json:
        typer.echo(json.dumps(result.to_dict()))
    else:
        _print_survey(Console(highlight=False, soft_wrap=True), result)


def read(
    target: TargetArgument,
    what: Annotated[
        list[str] | None,
        typer.Argument(
            help="Tags of the site (all of a device unless given), or "
            "[table:]address[:type[:length]].",
            metavar="WHAT",
        ),
    ] = None,
    device: DeviceName = None,
    unit: Unit = None,
    transport: Framing = "tcp",
    baud: Baud = 19200,
    parity: Parity = "even",
    stop_bits: StopBits = 1,
    timeout: Timeout = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
    server_name: ServerName = None,
    as_json: AsJson = False,
) -> None:
    """Read single values by tag (of a site) or by address.

    What can be read is printed, whatever cannot; the exit status is 2 if anything could not.
    """
    from fieldlink.cli.errors import explain
    from fieldlink.links import LinkError
    from fieldlink.links.by_hand import read_points

    options: dict[str, object] = {
        "unit": unit,
        "transport": transport,
        "baud": baud,
        "parity": parity,
    }
    options |= {"ca": ca, "cert": cert, "key": key, "server_name": server_name}
    points = [
        _point(target, text, device=device, stop_bits=stop_bits, timeout=timeout, **options)
        for text in what or _all_tags(target, device)
    ]
    shown: dict[str, object] = {}
    failed: list[LinkError] = []
    missing: list[Point] = []
    for name in dict.fromkeys(point.name for point in points):
        mine = [point for point in points if point.name == name]
        try:
            readings = asyncio.run(read_points(mine))
        except LinkError as error:
            failed.append(error)
            continue
        for point, reading in zip(mine, readings, strict=True):
            shown[point.tag.name] = _as_dict(point, reading)
            if not reading.was_read:
                missing.append(point)
            if not as_json:
                typer.echo(f"{point.tag.name} = {_value(point, reading)}   ({point.where})")
    if as_json and shown:
        typer.echo(json.dumps(shown))
    if failed and not shown:
        raise failed[0]
    for problem in failed:
        explain(problem)
    if missing:
        names = ", ".join(point.tag.name for point in missing)
        _warn(f"{names} could not be read; compare address, table and type with the manual")
    if failed or missing:
        raise typer.Exit(2)


def write(
    target: TargetArgument,
    what: Annotated[
        str,
        typer.Argument(help="Tag of the site, or [table:]address[:type[:length]].", metavar="WHAT"),
    ],
    value: Annotated[str, typer.Argument(help="Engineering value; true or false; text.")],
    device: DeviceName = None,
    unit: Unit = None,
    transport: Framing = "tcp",
    baud: Baud = 19200,
    parity: Parity = "even",
    stop_bits: StopBits = 1,
    timeout: Timeout = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
    server_name: ServerName = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Write one value, after a question; refuses what the site file does not allow.

    A site file allows tags that its register map calls writable, inside their range. Put -- before
    a negative value.
    """
    from fieldlink.links.by_hand import read_points, words_for, write_point

    options: dict[str, object] = {
        "unit": unit,
        "transport": transport,
        "baud": baud,
        "parity": parity,
    }
    options |= {"ca": ca, "cert": cert, "key": key, "server_name": server_name}
    point = _point(target, what, device=device, stop_bits=stop_bits, timeout=timeout, **options)
    if point.site is not None and what not in point.site.maps[point.name]:
        raise typer.BadParameter(
            f"{what} is an address; with a site file only its tags are written", param_hint="WHAT"
        )
    words = words_for(point, value)
    before = asyncio.run(read_points([point]))[0]
    typer.echo(f"{point.where} holds {_value(point, before)}")
    if not yes:
        if not sys.stdin.isatty():
            raise typer.BadParameter("nobody is there to be asked", param_hint="--yes")
        typer.confirm(f"write {value} {point.tag.unit}".rstrip() + "?", abort=True)
    after = asyncio.run(write_point(point, words))
    typer.echo(f"written; it holds {_value(point, after)} now")


def _point(target: str, text: str, *, device: str | None, **options: object) -> Point:
    """Return what ``text`` means on ``target``: a tag wherever it is, or an address."""
    from fieldlink.links.by_hand import ByHandError, Point, parse_point
    from fieldlink.site import load_site
    from fieldlink.site.errors import nearest

    if target.endswith(".toml"):
        site = load_site(target)
        owners = [
            name
            for name, tags in site.maps.items()
            if text in tags
            and (site.devices[name].is_modbus or site.devices[name].is_opcua)
            and device in (None, name)
        ]
        if len(owners) > 1:
            raise typer.BadParameter(
                f"{text} is a tag of {', '.join(owners)}; name one", param_hint="--device"
            )
        if owners:
            found = find_target(target, device=owners[0], **options)  # type: ignore[arg-type]
            assert found.site is not None
            return Point(found.name, found.device, found.site.maps[found.name][text], found.site)
        if ":" not in text and not text.isdecimal():
            known = [tag for tags in site.maps.values() for tag in tags]
            raise ByHandError(f"{text!r} is no tag of {target}; {nearest(text, known)}")
    found = find_target(target, device=device, **options)  # type: ignore[arg-type]
    return Point(found.name, found.device, parse_point(text, found.device), found.site)


def _all_tags(target: str, device: str | None) -> list[str]:
    found = find_target(target, device=device)
    if found.site is None:
        raise typer.BadParameter("a host has no tags; give addresses", param_hint="WHAT")
    return list(found.site.maps[found.name])


def _warn(message: str) -> None:
    typer.secho(f"fieldlink: {message}", err=True, fg=typer.colors.RED)


def _value(point: Point, reading: Reading) -> str:
    if reading.text is not None:
        return repr(reading.text)
    if reading.good:
        return f"{reading.value:.10g} {point.tag.unit}".rstrip()
    return f"no good value: {reading.quality.advice}"


def _as_dict(point: Point, reading: Reading) -> dict[str, object]:
    tag = point.tag
    found: dict[str, object] = {
        "value": reading.text if reading.text is not None else reading.value,
        "quality": reading.quality.name.lower(),
        "unit": tag.unit,
        "table": tag.table.value,
        "address": tag.address,
        "device": point.name,
    }
    if tag.node:
        found["node"] = tag.node
    if not reading.good:
        found["value"] = None
    return found


def _unit_ids(text: str) -> tuple[int, ...]:
    """Return the ids in ``1,5,10-20``."""
    ids: list[int] = []
    for part in filter(None, text.split(",")):
        low, _, high = part.strip().partition("-")
        if not low.isdecimal() or not (high or low).isdecimal():
            raise typer.BadParameter(f"{part!r} is no unit id and no range", param_hint="--units")
        ids.extend(range(int(low), int(high or low) + 1))
    if ids and max(ids) > 255:
        raise typer.BadParameter(f"{max(ids)} is above 255", param_hint="--units")
    return tuple(dict.fromkeys(ids))


def _tables(text: str) -> tuple[Table, ...]:
    """Return the tables in ``holding,input``; all of them for none."""
    from fieldlink.registers import Table

    names = [name.strip() for name in text.split(",") if name.strip()]
    if unknown := [name for name in names if name not in list(Table)]:
        raise typer.BadParameter(
            f"{unknown[0]!r} is no table; use {', '.join(Table)}", param_hint="--tables"
        )
    return tuple(Table(name) for name in names) or tuple(Table)


def _usual_units(found: Target) -> tuple[int, ...]:
    """Return the ids that most devices have; all of a serial line is asked for with --units."""
    return tuple(range(1, 17)) if found.device.is_rtu else (1, 255, 0, *range(2, 11))


def _print_survey(console: object, result: Survey) -> None:
    from rich.console import Console

    assert isinstance(console, Console)
    console.print(f"[bold]{result.where}[/bold]  {result.requests} requests")
    for unit in result.units:
        console.print(f"  unit {unit.unit} answers")
        for table in unit.tables:
            if not table.served:
                said = "not served"
            elif not table.ranges:
                said = f"nothing readable up to {table.looked_to}"
            else:
                said = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in table.ranges)
            console.print(f"    {table.table:8} {said}")
    if not result.units:
        console.print("  no unit answers")
    if result.silent:
        console.print(f"  silent: {', '.join(map(str, result.silent))}")
    alike = {unit.tables for unit in result.units}
    if len(result.units) > 3 and len(alike) == 1:
        console.print("  all units answer alike: probably one device that ignores the unit id")
    if not result.complete:
        console.print(f"[yellow]not complete[/yellow]: {result.note}")
