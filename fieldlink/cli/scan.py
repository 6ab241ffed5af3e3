"""``fieldlink scan``: which units of a device answer, and which addresses can be read."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.device_argument import (
    Connect,
    Target,
    TargetArgument,
    find_target,
    takes_connection,
)
from fieldlink.printable import quoted
from fieldlink.whole_numbers import whole_number

if TYPE_CHECKING:
    from rich.console import Console

    from fieldlink.links.survey import Survey, TableSurvey
    from fieldlink.registers import Table

__all__ = ["scan"]


@takes_connection(unit=False)
def scan(
    target: TargetArgument,
    units: Annotated[
        str, typer.Option(help="Unit ids to try, such as 1,5,10-20; for a site the device's own.")
    ] = "",
    tables: Annotated[
        str, typer.Option(help="Tables to look at, such as holding,input; all four unless given.")
    ] = "",
    first: Annotated[int, typer.Option(min=0, max=65535, help="First address to read.")] = 0,
    last: Annotated[int, typer.Option(min=0, max=65535, help="Last address to read.")] = 499,
    block: Annotated[int, typer.Option(min=1, max=125, help="Addresses asked for at once.")] = 100,
    thorough: Annotated[
        bool,
        typer.Option("--thorough", help="Try every address, also in long unreadable stretches."),
    ] = False,
    pause: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Seconds between two requests.")
    ] = 0.02,
    max_requests: Annotated[int, typer.Option(min=1, help="Highest number of requests.")] = 2000,
    out: Annotated[
        Path | None,
        typer.Option(help="New register map (.csv, .xlsx) of the registers that can be read."),
    ] = None,
    connect: Connect = Connect(),  # noqa: B008  (immutable)
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Find out which unit ids answer and which addresses can be read; nothing is written.

    The exit status is 1 when no unit answers or, with --out, no register can be read.
    """
    from fieldlink.cli.tables import data_console
    from fieldlink.links.survey import SurveySettings, survey

    if out is not None and os.path.exists(out):
        raise typer.BadParameter(f"{out} exists; choose another name", param_hint="--out")
    if last < first:
        raise typer.BadParameter(f"{last} is before --first {first}", param_hint="--last")
    found = find_target(target, connect)
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
        thorough=thorough,
        pause=pause,
        max_requests=max_requests,
    )
    errors = data_console(stderr=True, highlight=False)
    with errors.status("looking") as status:

        def progress(what: str, requests: int) -> None:
            status.update(f"{what}; {requests} of at most {max_requests} requests")

        result = asyncio.run(survey(found.device, settings, progress, found.resolve))
    if as_json:
        typer.echo(json.dumps(result.to_dict()))
    else:
        _print_survey(data_console(highlight=False, soft_wrap=True), result)
    if out is not None:
        _write_map(found, result, out, errors)
    if not result.units:
        raise typer.Exit(1)


def _write_map(found: Target, result: Survey, out: Path, errors: Console) -> None:
    """Read what can be read once more and write it as a register map with guessed types."""
    from fieldlink.links.single_values import Point, read_points
    from fieldlink.registers import DataType, Table, Tag
    from fieldlink.registers.guessed_tags import guess_tags
    from fieldlink.site.map_export import write_map

    ranges = [
        (Table(table.table), first, last)
        for unit in result.units[:1]
        for table in unit.tables
        if table.table in (Table.HOLDING, Table.INPUT)
        for first, last in table.ranges
    ]
    if not ranges:
        errors.print(f"{out} is not written: no register can be read")
        raise typer.Exit(1)
    unit, limit = result.units[0].unit, result.units[0].max_registers
    limits = {} if limit is None else {"max_registers": limit}
    device = found.device.model_copy(update={"unit": unit, **limits})
    words = [
        Tag(f"{table} {address}", table, address, DataType.UINT16)
        for table, first, last in ranges
        for address in range(first, last + 1)
    ]
    points = [Point(found.name, device, tag, found.site) for tag in words]
    readings = asyncio.run(read_points(points))
    read: dict[Table, dict[int, int]] = {}
    for tag, reading in zip(words, readings, strict=True):
        if reading.was_read:
            read.setdefault(tag.table, {})[tag.address] = int(reading.value)
    tags = guess_tags(read)
    write_map(tags, out)
    errors.print(
        f"written: {out} with {len(tags)} guessed tags of unit {unit}. Compare their values with "
        "the operator's screen and give them names, then"
    )
    place = f"--host {device.host} --port {device.port} " if not device.serial_port else ""
    errors.print(f"next: fieldlink init {out} {place}--unit {unit}", soft_wrap=True)


def _unit_ids(text: str) -> tuple[int, ...]:
    """Return the ids in ``1,5,10-20``."""
    ids: list[int] = []
    for part in filter(None, text.split(",")):
        low, _, high = part.strip().partition("-")
        first, last = whole_number(low, 255), whole_number(high or low, 255)
        if first is None or last is None:
            raise typer.BadParameter(
                f"{quoted(part)} is neither a unit id from 0 to 255 nor a range of them",
                param_hint="--units",
            )
        ids.extend(range(first, last + 1))
    return tuple(dict.fromkeys(ids))


def _tables(text: str) -> tuple[Table, ...]:
    """Return the tables in ``holding,input``; all of them for none."""
    from fieldlink.registers import Table

    names = [name.strip() for name in text.split(",") if name.strip()]
    if unknown := [name for name in names if name not in list(Table)]:
        raise typer.BadParameter(
            f"{unknown[0]!r} is not a table; use {', '.join(Table)}", param_hint="--tables"
        )
    return tuple(Table(name) for name in names) or tuple(Table)


def _usual_units(found: Target) -> tuple[int, ...]:
    """Return the ids that most devices have; all of a serial line is asked for with --units."""
    return tuple(range(1, 17)) if found.device.is_rtu else (1, 255, 0, *range(2, 11))


def _print_survey(console: Console, result: Survey) -> None:
    from rich.text import Text

    from fieldlink.printable import as_printable

    console.print(Text.assemble((result.where, "bold"), f"  {result.requests} requests"))
    for unit in result.units:
        console.print(f"  unit {unit.unit} answers")
        for table in unit.tables:
            console.print(f"    {table.table:8} {_describe(table)}")
        if unit.max_registers is not None:
            console.print(
                "    a longer request is refused although its registers can be read: set "
                f"max_registers = {unit.max_registers} in the site file"
            )
    if not result.units:
        console.print("  no unit answers")
    if result.silent:
        console.print(f"  silent: {', '.join(map(str, result.silent))}")
    for number, what in result.unfit:
        console.print(f"  unit {number}, no answer that fits: {as_printable(what)}")
    if not result.units and not result.unfit and result.complete:
        console.print("  name other ids with --units, or wait longer with --timeout")
    alike = {unit.tables for unit in result.units}
    if len(result.units) > 3 and len(alike) == 1:
        console.print("  all units answer alike: probably one device that ignores the unit id")
    if not result.complete:
        console.print(Text.assemble(("not complete", "yellow"), f": {result.note}"))


def _describe(table: TableSurvey) -> str:
    from fieldlink.cli.tables import counted
    from fieldlink.links import ExceptionCode

    if not table.served:
        return "not served"
    said = f"nothing readable up to {table.looked_to}"
    if table.ranges:
        said = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in table.ranges)
    if table.sampled:
        rough = ", ".join(f"{a}-{b}" for a, b in table.sampled)
        said += f" (only every tenth address tried in {rough}; --thorough tries all)"
    for number, requests in table.put_off:
        code = ExceptionCode.of(number)
        said += f" (exception {number} to {counted(requests, 'request')}: {code.advice})"
    return said
