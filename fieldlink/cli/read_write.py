"""``fieldlink read`` and ``fieldlink write``: single values by hand."""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.device_argument import Connect, TargetArgument, find_target, takes_connection

if TYPE_CHECKING:
    from fieldlink.links import Reading
    from fieldlink.links.single_values import Point

__all__ = ["is_odd", "is_terminal", "read", "value_text", "write"]

SMALLEST, LARGEST = 1e-9, 1e12
"""Sizes of measured values in engineering units. A float with exchanged registers has an exponent
made of other bits: it is outside of them two times of three."""


@takes_connection()
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
    connect: Connect = Connect(),  # noqa: B008  (immutable)
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Read single values by tag (of a site) or by address.

    Values that can be read are printed even if others cannot; the exit status is then 2.
    """
    from fieldlink.cli.errors import explain
    from fieldlink.links import LinkError, Quality
    from fieldlink.links.single_values import scan_points

    points = [_point(target, _meant(text), connect) for text in what or _all_tags(target, connect)]
    shown: dict[str, object] = {}
    failed: list[LinkError] = []
    missing: list[Point] = []
    odd: list[str] = []
    for name in dict.fromkeys(point.name for point in points):
        mine = [point for point in points if point.name == name]
        try:
            scan = asyncio.run(scan_points(mine))
        except LinkError as error:
            failed.append(error)
            continue
        if any(scan[point.tag.name].quality is Quality.NOT_READ for point in mine):
            failed += scan.failures
        for point in mine:
            reading = scan[point.tag.name]
            shown[point.tag.name] = _as_dict(point, reading)
            if not reading.was_read:
                missing.append(point)
            if is_odd(point, reading):
                odd.append(point.tag.name)
            if not as_json:
                typer.echo(f"{point.tag.name} = {value_text(point, reading)}   ({point.where})")
    if as_json and shown:
        typer.echo(json.dumps(shown))
    if odd:
        _warn(
            f"{', '.join(odd)}: a value as small or large as this often has its registers in the "
            "other order; if the operator's screen shows another value, change word_order of the "
            "device, or order in the register map"
        )
    if failed and not shown:
        raise failed[0]
    for problem in failed:
        explain(problem)
    if missing:
        names = ", ".join(point.tag.name for point in missing)
        advice = "" if failed else "; compare address, table and type with the manual"
        _warn(f"{names} could not be read{advice}")
    if failed or missing:
        raise typer.Exit(2)


@takes_connection()
def write(
    target: TargetArgument,
    what: Annotated[
        str,
        typer.Argument(help="Tag of the site, or [table:]address[:type[:length]].", metavar="WHAT"),
    ],
    value: Annotated[
        str, typer.Argument(metavar="VALUE", help="Engineering value; true or false; text.")
    ],
    connect: Connect = Connect(),  # noqa: B008  (immutable)
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Write one value, after a question; refuses what the site file does not allow.

    A site file allows tags that its register map calls writable, inside their range.
    """
    from fieldlink.links import LinkError
    from fieldlink.links.single_values import (
        as_manual_address,
        is_held,
        read_points,
        words_for,
        write_point,
    )

    if (other := as_manual_address(what)) is not None:
        digits, colon, kind = what.partition(":")
        raise typer.BadParameter(
            f"{what} may mean address {int(digits)}, or {other} as manuals write it; write "
            f"holding:{int(digits)}{colon}{kind} or {other}",
            param_hint="WHAT",
        )
    point = _point(target, what, connect)
    if point.site is not None and what not in point.site.maps[point.name]:
        raise typer.BadParameter(
            f"{what} is an address; with a site file only its tags are written", param_hint="WHAT"
        )
    words = words_for(point, value)
    before = asyncio.run(read_points([point]))[0]
    typer.echo(f"{point.where} holds {value_text(point, before)}")
    if not yes:
        if not is_terminal():
            raise typer.BadParameter(
                "not given, and there is no terminal to ask on; add it", param_hint="--yes"
            )
        typer.confirm(f"write {value} {point.tag.unit}".rstrip() + "?", abort=True)
    after = asyncio.run(write_point(point, words))
    if not is_held(point.tag, words, after):
        raise LinkError(
            point.name,
            f"the write was confirmed, but it holds {value_text(point, after)} now",
            "look for a limit or a protection of it in the device, and for a program or another "
            "client that writes it",
        )
    typer.echo(f"written; it holds {value_text(point, after)} now")


def is_odd(point: Point, reading: Reading) -> bool:
    """Whether a float looks as if its registers were exchanged; a true zero does not."""
    if not point.tag.data_type.value.startswith("float") or not reading.good:
        return False
    return reading.value != 0.0 and not SMALLEST <= abs(float(reading.value)) <= LARGEST


def _point(target: str, text: str, connect: Connect) -> Point:
    """Return what ``text`` means on ``target``: a tag wherever it is, or an address."""
    from fieldlink.links.single_values import ByHandError, Point, parse_point
    from fieldlink.site import load_site
    from fieldlink.site.errors import nearest

    if target.endswith(".toml"):
        site = load_site(target)
        owners = [
            name
            for name, tags in site.maps.items()
            if text in tags and not site.devices[name].is_stepped and connect.device in (None, name)
        ]
        if len(owners) > 1:
            raise typer.BadParameter(
                f"{text} is a tag of {', '.join(owners)}; name one", param_hint="--device"
            )
        if owners:
            found = find_target(target, replace(connect, device=owners[0]))
            assert found.site is not None
            return Point(found.name, found.device, found.site.maps[found.name][text], found.site)
        if ":" not in text and not text.isdecimal():
            known = [tag for tags in site.maps.values() for tag in tags]
            raise ByHandError(f"{text!r} is not a tag of {target}; {nearest(text, known)}")
    found = find_target(target, connect)
    return Point(found.name, found.device, parse_point(text, found.device), found.site)


def is_terminal() -> bool:
    """Whether there is a terminal to ask on."""
    return sys.stdin.isatty()


def _meant(text: str) -> str:
    """Return what an address such as 40001 means; asks where there is a terminal."""
    from fieldlink.links.single_values import as_manual_address

    other = as_manual_address(text)
    if other is None:
        return text
    if is_terminal():
        return other if typer.confirm(f"is {other} meant, which manuals write {text}?") else text
    number = int(text.partition(":")[0])
    _warn(f"{text} is read as address {number}; if the manual's {text} is meant, give {other}")
    return text


def _all_tags(target: str, connect: Connect) -> list[str]:
    found = find_target(target, connect)
    if found.site is None:
        raise typer.BadParameter("a host has no tags; give addresses", param_hint="WHAT")
    return list(found.site.maps[found.name])


def _warn(message: str) -> None:
    typer.secho(f"fieldlink: {message}", err=True, fg=typer.colors.RED)


def value_text(point: Point, reading: Reading) -> str:
    """Return a reading for a person: value and unit, or why there is no good value."""
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
