"""``fieldlink diagnose PATH...``: why a loop swings, and which loop started it."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fieldlink.diagnosing import Columns, Plant
    from fieldlink.diagnosis import Cause, Diagnosis
    from fieldlink.site.recording import Recording

__all__ = ["diagnose", "print_plant"]


def diagnose(
    paths: Annotated[
        list[Path],
        typer.Argument(
            help="A recording (CSV, Excel, Parquet, MATLAB) of one loop or several; many, or "
            "folders of them, of the same hours; or a site file (TOML), whose store is read.",
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
    loop: Annotated[
        str | None, typer.Option(help="The loop to diagnose, of a file with several.")
    ] = None,
    op_span: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            help="OP's span where no register map gives it; 100 unless given, or 1 where OP lies "
            "between 0 and 1. Noise that moves the valve is told by it.",
        ),
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
    """Say why a loop swings, what to do about it, and which of many loops started it.

    The exit status is 1 when some of several recordings cannot be used.
    """
    from fieldlink import diagnosing

    columns = diagnosing.Columns(op, pv, sp, auto, time, period, loop, op_span)
    sites = [path for path in paths if path.suffix.lower() == ".toml"]
    if sites and len(paths) > 1:
        raise typer.BadParameter(
            f"{sites[0]} is a site file: give it alone, or recorded loops", param_hint="PATH"
        )
    is_one_file = not sites and len(paths) == 1 and not os.path.isdir(paths[0])
    if loop is not None and not is_one_file:
        raise typer.BadParameter(
            "names a loop of one recording: give that file alone", param_hint="--loop"
        )
    if sites:
        from fieldlink.site import load_site

        site = load_site(sites[0])
        periods = {name: loop.period for name, loop in site.loops.items()}
        spans = {name: site.op_span(name) or op_span for name in site.loops}
        plant = diagnosing.diagnose_store(site.historian_url, periods, hours, spans)
    elif is_one_file:
        found = _of_file(paths[0], columns)
        if not isinstance(found, diagnosing.Plant):
            _show_one(loop or paths[0].name, *found, plot, as_json)
            return
        plant = found
    else:
        plant = diagnosing.diagnose_files(diagnosing.files_of(paths), columns)
    # The picture comes last: one that cannot be written must not cost the result.
    if as_json:
        typer.echo(json.dumps(plant.to_dict(), allow_nan=False))
    else:
        print_plant(plant)
    if plot is not None and plant.groups:
        from fieldlink.diagnosis_pictures import group_figure
        from fieldlink.pictures import save

        save(group_figure(plant, plant.groups[0], title=paths[0].name), plot)
    if plot is not None and not as_json:
        said = f"picture: {plot}" if plant.groups else "no picture: no loops swing together"
        typer.echo(said)
    if plant.refused and not sites:
        raise typer.Exit(1)


def _of_file(path: Path, columns: Columns) -> Plant | tuple[Recording, Diagnosis]:
    """Diagnose a file: its only loop or the one that was named, else all of them."""
    from fieldlink import diagnosing

    if columns.loop is not None:
        recording = diagnosing.read(path, columns)
    else:
        loops = diagnosing.loops_in(path, columns)
        if len(loops) > 1:
            return diagnosing.diagnose_loops(path, loops, columns.op_span)
        (read_only,) = loops.values()
        recording = read_only()
    return recording, diagnosing.diagnose_recording(recording, op_span=columns.op_span)


def _show_one(
    name: str, recording: Recording, found: Diagnosis, plot: Path | None, as_json: bool
) -> None:
    if as_json:
        typer.echo(json.dumps(found.to_dict(), allow_nan=False))
    else:
        _print_one(name, found)
        for note in recording.notes:
            typer.echo(f"note: {note}")
    if plot is not None:
        from fieldlink.diagnosis_pictures import diagnosis_figure
        from fieldlink.pictures import save

        save(diagnosis_figure(recording, found, title=name), plot)
        if not as_json:
            typer.echo(f"picture: {plot}")


_COUNTED = ("op_travel_per_day", "op_reversals_per_day")
"""Figures that other commands count in another way, by what they leave out."""
_COUNTED_NOTE = (
    "OP's travel and reversals: turns within two of its usual moves are left out; the work list "
    "leaves out those within 0.2 % of its span"
)
_SIGNALS = {"error": "the control error", "pv": "PV", "op": "OP"}
_UNITS = {"s": "s", "deg": "degrees", "share": "", "per_day": "a day", "per_hour": "an hour"}
"""Ends of a figure's name, and what a reader sees behind its value."""
_CAPITALS = {"op": "OP", "pv": "PV", "iae": "IAE", "ms": "Ms", "harris": "Harris", "bayes": "Bayes"}


def _print_one(name: str, found: Diagnosis) -> None:
    from rich.panel import Panel
    from rich.text import Text

    from fieldlink.cli.tables import data_console, format_bullet, labelled

    console = data_console()
    console.print(Panel(found.first.name.words, title=Text(name), expand=False))
    for cause in found.causes:
        part = _part_of(cause)
        of_trouble = f": {part} of the trouble" if part else ""
        console.print(Text.assemble((cause.name.words, "bold"), of_trouble))
        for sentence in cause.evidence:
            console.print(format_bullet(sentence))
        console.print(format_bullet(cause.action, "→"))
    console.print(_figures(found))
    for note in (*found.notes, *([_COUNTED_NOTE] if _COUNTED[0] in found.indices else [])):
        console.print(labelled("note", note))


def _part_of(cause: Cause) -> str:
    """How much of the loop's trouble a cause makes; nothing where none is known to make any."""
    if cause.name.value in ("quiet", "undetermined"):
        return ""
    return f"{cause.weight:.0%}"


def _figures(found: Diagnosis):  # type: ignore[no-untyped-def]
    """Controller, advice and figures as a table."""
    from rich.table import Table

    table = Table("figure", "value", box=None)
    swing = found.oscillation
    if swing.present:
        table.add_row(
            "oscillation",
            f"{swing.period_s:.4g} s in {_SIGNALS.get(found.oscillating, found.oscillating)}, "
            f"amplitude {swing.amplitude:.3g}, regularity {swing.regularity:.3g}, "
            f"{swing.cycles:.0f} periods",
        )
    if (one := found.controller) is not None:
        terms = [f"{one.structure}", f"gain {one.gain:.4g}"]
        if math.isfinite(one.integral_time_s):
            terms.append(f"integral time {one.integral_time_s:.4g} s")
        if one.derivative_time_s:
            terms.append(f"derivative time {one.derivative_time_s:.3g} s")
        terms.append(f"{one.action} acting")
        if not one.timed:
            terms.append(f"as read off: explains {one.explained:.0%} of OP's moves")
        table.add_row("controller", ", ".join(terms))
    if (tuning := found.tuning) is not None:
        for label, one in (
            ("proposed", tuning),
            *(("or", one) for one in tuning["alternatives"]),
        ):
            table.add_row(label, _settings_in_words(one, tuning))
        if tuning["note"]:
            table.add_row("", tuning["note"])
    for name, value in found.indices.items():
        # the row of the oscillation has its figures, or there is none
        if math.isfinite(value) and not name.startswith("oscillation_"):
            table.add_row(*_figure_in_words(name, value))
    return table


def _figure_in_words(name: str, value: float) -> tuple[str, str]:
    """A figure's name and value for a reader: the unit, which ends the name, behind the value."""
    end = next((one for one in _UNITS if name.endswith(f"_{one}")), None)
    words = name if end is None else name.removesuffix(f"_{end}")
    label = " ".join(_CAPITALS.get(word, word) for word in words.split("_"))
    if end == "share":
        return label, f"{value:.1%}"
    return label, f"{value:.4g} {'' if end is None else _UNITS[end]}".rstrip()


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


def print_plant(plant: Plant) -> None:
    """Print loops, the heaviest cause on top, and the groups with their likeliest sources."""
    from rich.table import Table
    from rich.text import Text

    from fieldlink.cli.tables import data_console, labelled

    console = data_console()
    table = Table("loop", "cause", "of its trouble", "period / s", "why, and what to do")
    for name, found in sorted(plant.loops.items(), key=lambda one: _urgency(one[1])):
        swing, first = found.oscillation, found.first
        why, todo = first.evidence[0], "" if first.name.value == "quiet" else first.action
        if (source := plant.source_of(name)) is not None:
            why = f"it swings with {source}, the likeliest source (below); by itself: {why}"
            todo = f"Put {source} right first, then diagnose this loop again."
        table.add_row(
            name,
            first.name.words,
            _part_of(first),
            f"{swing.period_s:.4g}" if swing.present else "",
            why + (f"\n→ {todo}" if todo else ""),
        )
    console.print(table)
    for group in plant.groups:
        together = f" swing together, {group.period_s:.4g} s"
        console.print(Text.assemble((", ".join(group.loops), "bold"), together))
        for place, one in enumerate(group.candidates[:3]):
            label = "likeliest source" if place == 0 else "or"
            who = one.loop or "outside of these loops"
            said = one.evidence or [f"against it: {text}" for text in one.against]
            console.print(f"  {label}: {who} ({one.weight:.0%}): {'; '.join(said)}")
    if not plant.groups and len(plant.loops) > 1:
        console.print("no loops were found to swing together")
    for note in plant.notes:
        console.print(labelled("note", note))
    for name, reason in plant.refused.items():
        console.print(labelled(name, f"not read: {reason}"))


def _urgency(found: Diagnosis) -> tuple[int, float]:
    """Loops with a cause first, the heaviest on top; then what is open, then what is quiet."""
    rank = {"undetermined": 1, "quiet": 2}.get(found.first.name.value, 0)
    return rank, -found.first.weight
