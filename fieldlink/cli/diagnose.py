"""``fieldlink diagnose PATH...``: why a loop swings, and which loop started it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fieldlink.diagnosing import Plant
    from fieldlink.diagnosis import Diagnosis

__all__ = ["diagnose"]


def diagnose(
    paths: Annotated[
        list[Path],
        typer.Argument(
            help="One recorded loop (CSV, Excel, Parquet, MATLAB); several, or folders of them, of "
            "the same hours; or a site file (TOML), whose store is read.",
            metavar="PATH...",
        ),
    ],
    op: Annotated[str | None, typer.Option(help="Column of the controller output.")] = None,
    pv: Annotated[str | None, typer.Option(help="Column of the process variable.")] = None,
    sp: Annotated[str | None, typer.Option(help="Column of the set-point.")] = None,
    auto: Annotated[
        str | None, typer.Option(help="Column that is 1 (or true) while in automatic.")
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of the time stamps.")] = None,
    period: Annotated[
        float | None, typer.Option(help="Sampling period in seconds; from the times unless given.")
    ] = None,
    hours: Annotated[
        float, typer.Option(min=0.1, help="For a site: hours of its record, up to now.")
    ] = 24.0,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Write a picture of the loop, or of the largest group (PNG, SVG or PDF)."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Say why a loop swings, what to do about it, and which of many loops started it."""
    from fieldlink import diagnosing

    columns = diagnosing.Columns(op, pv, sp, auto, time, period)
    sites = [path for path in paths if path.suffix.lower() == ".toml"]
    if sites and len(paths) > 1:
        raise typer.BadParameter(
            f"{sites[0]} is a site file: give it alone, or recorded loops", param_hint="PATH"
        )
    several = bool(sites) or len(paths) > 1 or os.path.isdir(paths[0])
    if sites:
        from fieldlink.site import load_site

        site = load_site(sites[0])
        periods = {name: loop.period for name, loop in site.loops.items()}
        plant = diagnosing.diagnose_store(site.historian_url, periods, hours)
    elif several:
        plant = diagnosing.diagnose_files(diagnosing.files_of(paths), columns)
    else:
        _one(paths[0], columns, plot, as_json)
        return
    if plot is not None and plant.groups:
        from fieldlink.diagnosis_pictures import group_figure
        from fieldlink.pictures import save

        save(group_figure(plant, plant.groups[0], title=paths[0].name), plot)
    if as_json:
        typer.echo(json.dumps(plant.to_dict(), allow_nan=False))
        return
    _print_plant(plant)
    if plot is not None:
        said = f"picture: {plot}" if plant.groups else "no picture: no loops swing together"
        typer.echo(said)


def _one(path: Path, columns: object, plot: Path | None, as_json: bool) -> None:
    from fieldlink import diagnosing

    assert isinstance(columns, diagnosing.Columns)
    recording = diagnosing.read(path, columns)
    found = diagnosing.diagnose_recording(recording)
    if plot is not None:
        from fieldlink.diagnosis_pictures import diagnosis_figure
        from fieldlink.pictures import save

        save(diagnosis_figure(recording, found, title=path.name), plot)
    if as_json:
        typer.echo(json.dumps(found.to_dict(), allow_nan=False))
        return
    _print_one(path.name, found)
    for note in recording.notes:
        typer.echo(f"note: {note}")
    if plot is not None:
        typer.echo(f"picture: {plot}")


_COUNTED = dict.fromkeys(
    ("op_travel_per_day", "op_reversals_per_day"),
    "turns within two of OP's usual moves left out; the work list: within 0.2 % of OP's span",
)
"""What figures that other commands count in another way leave out."""
_SIGNALS = {"error": "the control error", "pv": "PV", "op": "OP"}


def _print_one(name: str, found: Diagnosis) -> None:
    from rich.panel import Panel
    from rich.text import Text

    from fieldlink.cli.tables import data_console, format_bullet, labelled

    console = data_console()
    first = found.first
    found_first = f"{first.name.words} ({first.weight:.0%})"
    console.print(Panel(found_first, title=Text(name), expand=False))
    for cause in found.causes:
        weight = f", weight {cause.weight:.2f}"
        console.print(Text.assemble((cause.name.words, "bold"), weight))
        for sentence in cause.evidence:
            console.print(format_bullet(sentence))
        console.print(format_bullet(cause.action, "→"))
    console.print(_figures(found))
    for note in found.notes:
        console.print(labelled("note", note))


def _figures(found: Diagnosis):  # type: ignore[no-untyped-def]
    """Controller, advice and figures as a table."""
    from rich.table import Table

    table = Table("figure", "value", box=None)
    swing = found.oscillation
    signal = f"of {_SIGNALS.get(found.oscillating, found.oscillating)}"
    if swing.present:
        table.add_row(
            "oscillation",
            f"{swing.period_s:.4g} s, amplitude {swing.amplitude:.3g}, regularity "
            f"{swing.regularity:.3g}, {swing.cycles:.0f} periods",
        )
    if (one := found.controller) is not None:
        table.add_row(
            "controller",
            f"{one.structure}, gain {one.gain:.4g}, integral time {one.integral_time_s:.4g} s, "
            f"derivative time {one.derivative_time_s:.3g} s, {one.action} acting",
        )
    if (tuning := found.tuning) is not None:
        for label, one in (
            ("proposed", tuning),
            *(("or", one) for one in tuning["alternatives"]),
        ):
            table.add_row(label, _settings_in_words(one, tuning))
        if tuning["note"]:
            table.add_row("", tuning["note"])
    for name, value in found.indices.items():
        if value == value:
            hint = signal if name == "oscillation_period_s" else _COUNTED.get(name, "")
            table.add_row(name, f"{value:.4g} ({hint})" if hint else f"{value:.4g}")
    return table


def _settings_in_words(one: Mapping[str, Any], all_of_it: Mapping[str, Any]) -> str:
    """Proposed settings with their robustness and what they would do to the record."""
    derivative = (
        f", derivative time {one['derivative_time_s']:.3g} s" if one["derivative_time_s"] else ""
    )
    error, travel = (all_of_it[f"simulated_running_{name}"] for name in ("error_std", "op_travel"))
    change = "error as now"
    if error > 0.0:
        low, high = (one[f"predicted_error_std_{end}"] / error - 1.0 for end in ("low", "high"))
        change = f"error {low:+.0%} to {high:+.0%}"
    if travel > 0.0:
        change += f", OP travel {one['predicted_op_travel'] / travel - 1.0:+.0%}"
    return (
        f"{one['structure']}, gain {one['gain']:.4g}, integral time {one['integral_time_s']:.4g} s"
        f"{derivative} (Ms {one['ms']:.2f}, now {all_of_it['running_ms']:.2f}): {change}; "
        f"{one['rule']}"
    )


def _print_plant(plant: Plant) -> None:
    from rich.table import Table
    from rich.text import Text

    from fieldlink.cli.tables import data_console, labelled

    console = data_console()
    table = Table("loop", "cause", "weight", "period / s", "evidence")
    for name, found in plant.loops.items():
        swing = found.oscillation
        table.add_row(
            name,
            found.first.name.words,
            f"{found.first.weight:.2f}",
            f"{swing.period_s:.4g}" if swing.present else "",
            found.first.evidence[0],
        )
    console.print(table)
    for group in plant.groups:
        together = f" swing together, {group.period_s:.4g} s"
        console.print(Text.assemble((", ".join(group.loops), "bold"), together))
        for one in group.candidates[:3]:
            who = one.loop or "outside of these loops"
            console.print(f"  candidate {who} ({one.weight:.0%}): {'; '.join(one.evidence)}")
    for name, reason in plant.refused.items():
        console.print(labelled(name, f"not read: {reason}"))
