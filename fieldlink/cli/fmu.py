"""``fieldlink fmu``: look at an FMU, run it, sweep a plant, begin a model of one's own."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fieldlink.cli.fmu_progress import FmuProgress
from fieldlink.cli.fmu_sweep import sweep
from fieldlink.cli.fmu_tables import print_result, print_summary
from fieldlink.cli.outputs import refuse_folder, refuse_source

if TYPE_CHECKING:
    from fieldlink.lab.fmu import FmuMap
    from fmu_models import FmuSummary, StartValue

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="Look at FMUs and run them; sweep the plants.")

app.command("sweep")(sweep)
FmuFile = Annotated[Path, typer.Argument(metavar="FMU", help="An .fmu file, or a plant's name.")]


def _file(given: Path) -> Path:
    """A plant of the catalogue by name, or a file."""
    from fmu_models import catalogue, fmu_path

    name = str(given)
    if os.path.exists(given) or given.suffix or given.name != name:
        return given
    if name not in catalogue:
        from fieldlink.lab.fmu.errors import nearest

        raise typer.BadParameter(
            f"{name} is neither a file nor a plant of the catalogue; {nearest(name, catalogue)}",
            param_hint="FMU",
        )
    return fmu_path(name)


@app.command("info")
def info(
    fmu: FmuFile,
    every: Annotated[
        bool, typer.Option("--all", help="List every variable, local ones included.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Describe an FMU; nothing of it runs."""
    from fmu_models import summarise

    summary = summarise(_file(fmu))
    if as_json:
        document = dataclasses.asdict(summary) | {"file": str(summary.file)}
        typer.echo(json.dumps(document))
        return
    print_summary(summary, every)


def _start_values(pairs: list[str], summary: FmuSummary) -> dict[str, StartValue]:
    """Read the NAME=VALUE pairs of --set."""
    from fieldlink.lab.fmu.start_text import read_start_value

    values: dict[str, StartValue] = {}
    for pair in pairs:
        name, text = _split(pair, summary)
        try:
            if not name:
                raise ValueError(f"{pair!r} is not NAME=VALUE")
            values[name] = read_start_value(summary, name, text)
        except ValueError as error:
            raise typer.BadParameter(
                f"{pair}: {error}; give NAME=VALUE, for instance noise_std=0.1",
                param_hint="--set",
            ) from None
    return values


def _split(pair: str, summary: FmuSummary) -> tuple[str, str]:
    """Divide NAME=VALUE where both may hold signs of equality; the longest known name wins."""
    places = [i for i, sign in enumerate(pair) if sign == "="]
    known = [i for i in places if summary.variable(pair[:i]) is not None]
    place = max(known or places[:1], default=0)
    return pair[:place], pair[place + 1 :]


@app.command("run")
def run(
    fmu: FmuFile,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="TOML: which tag is which variable.")
    ] = None,
    stop: Annotated[float | None, typer.Option(help="Second at which the run ends.")] = None,
    step: Annotated[float | None, typer.Option(help="Seconds a step.")] = None,
    inputs: Annotated[
        Path | None, typer.Option(help="CSV: time and a column for each driven tag or variable.")
    ] = None,
    start_values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A start value: a number, word or text."),
    ] = None,
    watch: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Record this variable too.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write the table: .csv or .parquet.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG, SVG or PDF).")] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=1e-6, help="Plant seconds per second; no limit unless given."),
    ] = None,
    kind: Annotated[str | None, typer.Option(help='"co-simulation" or "model exchange".')] = None,
    load_state: Annotated[Path | None, typer.Option(help="Begin from this saved state.")] = None,
    save_state: Annotated[Path | None, typer.Option(help="Save the state here.")] = None,
    snapshot_at: Annotated[
        float | None, typer.Option(help="Second of the saved state; else the end.")
    ] = None,
    in_process: Annotated[
        bool,
        typer.Option(
            "--in-process",
            help="Run the FMU in this process: faster, but its crash ends fieldlink.",
        ),
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds that a step may take.")] = 60.0,
    master: Annotated[
        Literal["gauss-seidel", "jacobi"] | None,
        typer.Option(help="How a system's components exchange values; Gauss-Seidel unless given."),
    ] = None,
    intermediate: Annotated[
        Path | None,
        typer.Option(help="CSV of the outputs between the ends of a step, where FMI 3 has them."),
    ] = None,
    export: Annotated[
        Path | None, typer.Option(help="Write an .ssp that repeats this run, recordings inside.")
    ] = None,
) -> None:
    """Run an FMU: its own default experiment, or as map, inputs and options say."""
    from fieldlink.lab.fmu import (
        FmuMap,
        RunSettings,
        TableFile,
        export_system,
        load_map,
        run_fmu,
    )
    from fieldlink.lab.fmu.experiment import choose_stop
    from fieldlink.lab.fmu.inputs import read_inputs
    from fmu_models import summarise

    if plot is not None:  # before the run: a library that is missing must not cost it
        from fieldlink.lab.fmu.pictures import run_figure
        from fieldlink.pictures import save
    for written, option in ((plot, "--plot"), (save_state, "--save-state"), (export, "--export")):
        refuse_folder(written, option)
    if snapshot_at is not None and save_state is None:
        raise typer.BadParameter("needs --save-state FILE", param_hint="--snapshot-at")
    if export is not None and (map_file is not None or export.suffix != ".ssp"):
        raise typer.BadParameter(
            "takes a file that ends in .ssp, and no --map: a system has variables, no tags",
            param_hint="--export",
        )
    for written, option in ((out, "--out"), (intermediate, "--intermediate")):
        refuse_source(written, [path for path in (inputs, map_file) if path is not None], option)
    summary = summarise(_file(fmu))
    mapping = FmuMap() if map_file is None else load_map(map_file, summary)
    chosen = _start_values(start_values or [], summary)
    series = None
    if inputs is not None:
        words = _drivable(summary, mapping, chosen)
        series = read_inputs(inputs, words, words)
    table = None if out is None else TableFile(out)
    settings = RunSettings(
        stop=stop,
        step=step,
        start_values=chosen,
        inputs=series,
        watch=tuple(watch or ()),
        kind=kind,
        speed=speed,
        isolated=not in_process,
        timeout=timeout,
        master=master,
        intermediate=intermediate,
        table=table,
        load=load_state,
        save=save_state,
        save_at=snapshot_at,
    )
    with FmuProgress(summary.name, choose_stop(summary, stop)) as progress:
        result = run_fmu(summary, mapping, settings, progress)
    print_result(result)
    if table is not None:
        table.finish(result)
        typer.echo(f"table: {out}")
    if intermediate is not None:
        typer.echo(f"between the steps: {intermediate}")
    if export is not None:
        export_system(summary, result, export, master)
        typer.echo(f"system: {export}")
    if plot is not None:
        save(run_figure(result), plot)
        typer.echo(f"picture: {plot}")
    if result.failure is not None:
        from fieldlink.lab.fmu import FmuError

        raise FmuError(f"it ended early, at {result.time[-1]:g} s: {result.failure}")


def _drivable(
    summary: FmuSummary, mapping: FmuMap, start_values: dict[str, StartValue]
) -> dict[str, dict[str, float]]:
    """Names that a column of the inputs may have, with the words that stand for their values.

    They are the mapped tags, and the inputs that are not mapped.
    """
    from fieldlink.lab.fmu.signals import Signals, words_of

    given = {**mapping.parameters, **start_values}
    sizes = {name: value for name, value in given.items() if not isinstance(value, str)}
    signals = Signals(summary, mapping, sizes, ())
    return {
        tag: words_of(summary.variable(entry.variable)) for tag, entry in signals.inputs.items()
    }


@app.command("new")
def new(
    name: Annotated[str, typer.Argument(help="Name of the model, in small letters: my_tank.")],
    output: Annotated[Path, typer.Option(help="Folder of the C file.")] = Path(),
) -> None:
    """Begin a plant of your own: a C file that builds and runs, with what to fill in."""
    from fmu_models.template import new_model

    file = new_model(name, output)
    typer.echo(f"{file}: fill in what is marked with (1) to (6), then")
    typer.echo(f"  python -m fmu_models.build {file} --output {output}")
    typer.echo(f"  fieldlink fmu run {output / f'{name}.fmi3.fmu'} --plot {name}.png")


@app.command("loop")
def loop(
    fmu: FmuFile,
    op: Annotated[
        str, typer.Option(help="Input that the controller's output (0 to 100 %) drives.")
    ],
    pv: Annotated[str, typer.Option(help="Output that is controlled.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "--out", help="The scenario; else NAME.toml in this folder."),
    ] = None,
    start_values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A start value: a number, word or text."),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="Seconds of a scan; else the FMU's step, or a tenth of its lag."),
    ] = None,
    op_start: Annotated[
        float | None, typer.Option(help="Input at the start, percent; else its start value.")
    ] = None,
    op_scale: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=1e6,
            help="The input for 1 % of OP: 0.01 for an opening from 0 to 1; else 1.",
        ),
    ] = None,
    stick_band: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="S of the valve, % of OP.")
    ] = 5.0,
    slip_jump: Annotated[
        float, typer.Option(min=0.0, help="J of the valve, % of OP, at most S.")
    ] = 1.5,
) -> None:
    """Put a process of your own into a loop with a sticky valve: a scenario to rehearse."""
    from fieldlink.lab.fmu.loop_scenario import write_scenario
    from fieldlink.lab.fmu.step_test import STEP, LoopWish, respond
    from fmu_models import summarise

    if slip_jump > stick_band:
        raise typer.BadParameter(
            f"a valve that sticks by S = {stick_band:g} cannot jump by J = {slip_jump:g}; give at "
            f"most {stick_band:g}",
            param_hint="--slip-jump",
        )
    summary = summarise(_file(fmu))
    wish = LoopWish(
        op, pv, period, op_start, stick_band, slip_jump, op_scale,
        _start_values(start_values or [], summary),
    )  # fmt: skip
    response = respond(summary, wish)
    gain, integral_time = response.tune()
    file = output or Path(f"{fmu.stem}.toml")
    write_scenario(summary, wish, response, file)
    unit = " a second" if response.integrates else ""
    typer.echo(
        f"{pv} changes by {response.gain:.3g}{unit} for each percent of OP, "
        f"lag {response.lag:.3g} s, dead time {response.dead_time:.3g} s; "
        f"scan every {response.period:g} s"
    )
    low, high = response.op, response.op + STEP
    typer.echo(f"{op} was stepped from {low * wish.scale:g} to {high * wish.scale:g}")
    if response.has_own_valve:
        typer.echo(
            f"note: {response.remains:.0%} of {pv}'s response are left when {op} has gone back: "
            "the plant seems to have a sticky valve of its own, and the scenario puts another in "
            "front of it; switch it off, such as with --set valve=0"
        )
    typer.echo(f"PI by SIMC: gain {gain:.3g}, integral time {integral_time:.3g} s")
    typer.echo(f"{file}: fieldlink rehearse {file} --report report")
