"""What ``fieldlink init`` does with a new site: read it, run it a minute, say what is next."""

from __future__ import annotations

import asyncio
from pathlib import Path

import typer

from fieldlink.cli import read_write
from fieldlink.printable import as_printable

__all__ = ["next_step", "read_once", "run_trial", "say"]

COUNTS_FASTER = 0.7
"""Share of the period below which the controller's cycle is another one, not a late reading."""


def say(text: str) -> None:
    """Print a line for a person, on stderr; its indent is kept."""
    indent = text[: len(text) - len(text.lstrip())]
    typer.echo(indent + as_printable(text.lstrip()), err=True)


def read_once(out: Path) -> bool:
    """Read every tag of the new site once and print it; return whether the PLC answered."""
    from fieldlink.links import LinkError
    from fieldlink.links.single_values import Point, read_points
    from fieldlink.site import load_site
    from fieldlink.site.role_evidence import HIGHEST, LOWEST
    from fieldlink.site.site_draft import map_path_of

    site = load_site(out)
    device = site.devices["plc"]
    points = [Point("plc", device, tag, site) for tag in site.maps["plc"].values()]
    typer.echo(f"\nreading every tag of {device.where} once")
    try:
        readings = asyncio.run(read_points(points))
    except LinkError as error:
        say(f"not read: {error}")
        return False
    for point, reading in zip(points, readings, strict=True):
        say(f"  {point.tag.name} = {read_write.value_text(point, reading)}")
    odd = [
        point.tag.name
        for point, reading in zip(points, readings, strict=True)
        if read_write.is_odd(point, reading)
    ]
    if odd:
        say(
            f"  {', '.join(odd)}: a value as small or large as this often has its registers in the "
            "other order; if the operator's screen shows another value, make the site again with "
            "the other --word-order and a new --out"
        )
    found = {p.tag.name: reading for p, reading in zip(points, readings, strict=True)}
    for name, loop in site.loops.items():
        op = found[loop.op]
        if op.good and not LOWEST <= float(op.value) <= HIGHEST:
            say(
                f"  {name}: OP {loop.op} is {op.value:g}, and an OP is from 0 to 100 %: if the "
                "operator's screen shows another value, give the tag its scale (or raw_low, "
                f"raw_high, eng_low and eng_high) in {map_path_of(out)}"
            )
        mode = None if loop.mode is None else found[loop.mode]
        if mode is not None and mode.good and mode.value not in loop.auto_values:
            values = ", ".join(f"{value:g}" for value in loop.auto_values)
            say(
                f"  {name}: {loop.mode} is {mode.value:g}, which counts as manual; if it means "
                f"automatic, set auto_values = [{values}, {mode.value:g}] in {out}"
            )
    return True


def run_trial(out: Path) -> bool:
    """Run the new site for a minute and print the outcome; return whether all is well."""
    from fieldlink.daemon import configure_logging, trial
    from fieldlink.site import load_site

    configure_logging()
    typer.echo(f"\nrunning the site for {trial.TRIAL:g} s; nothing is written")
    site = load_site(out)
    found = asyncio.run(trial.try_site(site, trial.TRIAL))
    for name, loop in found.items():
        say(
            f"  {name}: {loop.read} of {loop.expected} samples read, {loop.bad} bad, "
            f"{loop.missed} missed; {loop.reason or loop.evidence.sentence}"
        )
        cycle = trial.TRIAL / max(1, loop.expected)
        if site.loops[name].scan is not None and cycle < COUNTS_FASTER * site.loops[name].period:
            say(
                f"  {name}: the controller counts a cycle every {cycle:.2g} s, and the loop's "
                f"period is {site.loops[name].period:g} s: set period = {cycle:.2g} in {out}"
            )
        if loop.looks_swapped:
            say(f"  {name}: OP and PV look exchanged; if they are, exchange them in {out}")
    return all(loop.is_good for loop in found.values())


def next_step(out: Path, host: str | None, answers: bool, tried: bool | None) -> str:
    """Return the command to type next."""
    if host is None:
        return f"put the PLC's host into {out}, then fieldlink read {out}"
    if not answers:
        return f"fieldlink read {out}, once the PLC can be reached"
    if tried is False:
        return f"correct what the lines above name; fieldlink read {out} shows single values"
    return f"compare the values with the operator's screen, then fieldlink run {out}"
