"""``fieldlink identify FILE``: judge one recorded loop."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.progress import show_work
from fieldlink.one_window import LONGEST_WINDOW, refuse_too_long
from fieldlink.printable import as_text

if TYPE_CHECKING:
    from estimator import Identification
    from fieldlink.site.recording import Recording

__all__ = ["identify", "warm_up"]


def _window(text: str | None, rows: int) -> slice:
    """Parse ``START:STOP`` (rows, as a Python slice; either side may be left out)."""
    if text is None:
        return slice(0, rows)
    parts = text.split(":")
    try:
        if len(parts) != 2:
            raise ValueError
        start = int(parts[0]) if parts[0] else 0
        stop = int(parts[1]) if parts[1] else rows
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not START:STOP in rows, for instance 100:1100", param_hint="--window"
        ) from None
    if not 0 <= start < stop <= rows:
        raise typer.BadParameter(
            f"{text!r} does not lie inside the recording's rows 0:{rows}", param_hint="--window"
        )
    return slice(start, stop)


def identify(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A recorded loop: CSV, Excel, Parquet or MATLAB; columns are found by name. Of a "
            "file with several loops --loop names one.",
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
        str | None, typer.Option(help="The loop to judge, of a file with several.")
    ] = None,
    criterion: Annotated[
        str,
        typer.Option(
            help="auto (coloured noise), oe or arx.", autocompletion=lambda: ["auto", "oe", "arx"]
        ),
    ] = "auto",
    confidence: Annotated[float, typer.Option(help="Confidence of the intervals.")] = 0.9,
    window: Annotated[
        str | None,
        typer.Option(
            help=f"Judge these rows only: START:STOP; at most {LONGEST_WINDOW} at a time."
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG, SVG or PDF).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Identify the valve of one recorded loop: verdict, stick band, slip jump, process."""
    import estimator
    from fieldlink.site.missing_rows import fill_missing_rows
    from fieldlink.site.recording import read_recording

    recording = read_recording(
        file, op=op, pv=pv, sp=sp, auto=auto, time=time, period=period, loop=loop
    )
    name = file.name if loop is None else loop
    rows = _window(window, len(recording.op))
    cut = fill_missing_rows(recording.cut(rows))
    refuse_too_long(as_text(str(file)), len(cut), rows)
    with show_work(f"judging {len(cut)} samples"):
        result = estimator.identify(
            cut.op,
            cut.pv,
            sp=cut.sp,
            auto=cut.auto,
            period=cut.period,
            criterion=criterion,
            confidence=confidence,
            surface=plot is not None,
        )
    # The picture comes last: one that cannot be written must not cost the result.
    if as_json:
        typer.echo(json.dumps({**result.to_dict(), **_origin()}, allow_nan=False))
    else:
        _print_summary(name, cut, result)
    if plot is not None:
        from fieldlink.pictures import identification_figure, save

        save(identification_figure(cut.op, cut.pv, cut.sp, result, title=name), plot)
        if not as_json:
            typer.echo(f"picture: {plot}")


def _origin() -> dict[str, object]:
    """What the JSON says beside the result: who computed it, and in which units its figures are.

    A recording does not tell the units of its columns, so they stand for themselves.
    """
    return {
        "fieldlink_version": version("fieldlink"),
        "units": {
            **dict.fromkeys(
                ("stick_band", "slip_jump", "static_friction", "dynamic_friction"), "OP"
            ),
            "gain": "PV/OP",
            "period_s": "s",
        },
    }


def _print_summary(name: str, recording: Recording, result: Identification) -> None:
    from rich.panel import Panel
    from rich.text import Text

    from fieldlink.cli.tables import (
        data_console,
        format_bullet,
        identification_table,
        labelled,
        verdict_text,
    )

    console = data_console()
    span = f"{result.samples} samples, {result.period_s:g} s apart"
    console.print(Panel(verdict_text(result), title=Text(name), subtitle=span, expand=False))
    for note in recording.notes:
        console.print(labelled("note", note))
    console.print(identification_table(result))
    for reason in result.reasons:
        console.print(format_bullet(f"{reason}. {reason.advice}"))


def warm_up() -> None:
    """Compile the numeric kernels now, so that no first deadline has to wait for them."""
    from fieldlink.cli.kernels import compile_kernels

    compile_kernels()
    typer.echo("numeric kernels are compiled")
