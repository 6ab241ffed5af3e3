"""``fieldlink fmu``: look at an FMU, run it, sweep a plant, begin a model of one's own."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from fieldlink.lab.fmu import FmuMap, RunResult
    from fmu_models import FmuSummary

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="Look at FMUs and run them; sweep the plants.")

_MOST_ROWS = 40
_CATALOGUE_STEPS = 2000
FmuFile = Annotated[Path, typer.Argument(metavar="FMU", help="An .fmu file, or a plant's name.")]


def _file(given: Path) -> Path:
    """A plant of the catalogue by name, or a file."""
    from fmu_models import catalogue, fmu_path

    name = str(given)
    return fmu_path(name) if name in catalogue and not given.exists() else given


@app.command("info")
def info(
    fmu: FmuFile,
    every: Annotated[
        bool, typer.Option("--all", help="List every variable, local ones included.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Describe an FMU before anything of it runs."""
    from fmu_models import summarise

    summary = summarise(_file(fmu))
    if as_json:
        typer.echo(json.dumps(dataclasses.asdict(summary) | {"file": str(summary.file)}))
        return
    _print_summary(summary, every)


def _print_summary(summary: FmuSummary, every: bool) -> None:
    from rich.console import Console
    from rich.panel import Panel
    from rich.table import Table

    console = Console()
    console.print(
        Panel(summary.description or "(no description)", title=summary.name, expand=False)
    )
    stop = "not given" if summary.stop_time is None else f"{summary.stop_time:g} s"
    step = "not given" if summary.step_size is None else f"{summary.step_size:g} s"
    here = "" if summary.runs_here else "  [red](not this machine)[/red]"
    facts = Table(box=None, show_header=False, pad_edge=False)
    for name, value in (
        ("FMI", f"{summary.fmi_version}, {', '.join(summary.kinds)}"),
        ("exported by", summary.tool or "-"),
        ("libraries for", (", ".join(summary.platforms) or "none") + here),
        ("sources", "yes" if summary.has_sources else "no"),
        ("size", f"{summary.bytes / 1024:.0f} kB, {summary.extracted_bytes / 1024:.0f} kB open"),
        ("experiment", f"{summary.start_time:g} s to {stop}, step {step}"),
        ("snapshots", "yes" if summary.can_restore else "no"),
        ("variables", f"{len(summary.variables)}, {summary.states} continuous states"),
    ):
        facts.add_row(name, value)
    console.print(facts)
    console.print(_variables_table(summary, every))
    hidden = sum(v.causality == "local" for v in summary.variables)
    if hidden and not every:
        console.print(f"and {hidden} local variables: --all shows them", style="dim")
    for warning in summary.warnings:
        console.print(f"[yellow]note[/yellow] {warning}", highlight=False)


def _variables_table(summary: FmuSummary, every: bool) -> Any:
    from rich.markup import escape
    from rich.table import Table

    table = Table(header_style="bold", box=None, pad_edge=False)
    for column in ("variable", "role", "type", "unit", "start", "range", "what"):
        table.add_column(column, overflow="fold")
    for v in summary.variables:
        if v.causality in ("local", "independent") and not every:
            continue
        what = v.description
        if v.items:
            what += " (" + ", ".join(f"{value} {name}" for value, name in v.items) + ")"
        bounds = f"{v.low or '…'} to {v.high or '…'}" if v.low or v.high else ""
        role = f"{v.variability} {v.causality}" if v.causality == "parameter" else v.causality
        cells = (v.name, role, v.type, v.unit, v.start, bounds, what.strip())
        table.add_row(*map(escape, cells))
    return table


def _start_values(pairs: list[str], summary: FmuSummary) -> dict[str, float]:
    """Read NAME=NUMBER; true, false and the names of an enumeration's values are numbers too."""
    values: dict[str, float] = {}
    for pair in pairs:
        name, _, text = pair.rpartition("=")
        variable = summary.variable(name)
        words = {"true": 1, "false": 0}
        if variable is not None:
            words |= {item: value for value, item in variable.items}
        try:
            if not name:
                raise ValueError
            values[name] = float(words.get(text, text))
        except ValueError:
            hint = (
                f" or one of {', '.join(words)}" if variable is not None and variable.items else ""
            )
            raise typer.BadParameter(
                f"{pair!r} is not NAME=NUMBER, for instance noise_std=0.1{hint}",
                param_hint="--set",
            ) from None
    return values


@app.command("run")
def run(
    fmu: FmuFile,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="TOML: which tag is which variable.")
    ] = None,
    stop: Annotated[float | None, typer.Option(help="Second at which it ends.")] = None,
    step: Annotated[float | None, typer.Option(help="Seconds a step.")] = None,
    inputs: Annotated[
        Path | None, typer.Option(help="CSV: time and a column for each driven tag or variable.")
    ] = None,
    start_values: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=NUMBER", help="A start value.")
    ] = None,
    watch: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Record this variable too.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write the table: .csv or .parquet.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG, SVG or PDF).")] = None,
    speed: Annotated[
        float | None, typer.Option(min=1e-6, help="Plant seconds a second; else as fast as can be.")
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
) -> None:
    """Run an FMU: its own default experiment, or as map, inputs and options say."""
    from fieldlink.lab.fmu import FmuMap, RunSettings, TableFile, load_map, run_fmu
    from fieldlink.lab.fmu.experiment import choose_stop
    from fieldlink.lab.fmu.inputs import read_inputs
    from fmu_models import summarise

    if snapshot_at is not None and save_state is None:
        raise typer.BadParameter("needs --save-state FILE", param_hint="--snapshot-at")
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
        table=table,
        load=load_state,
        save=save_state,
        save_at=snapshot_at,
    )
    with _Progress(summary.name, choose_stop(summary, stop)) as progress:
        result = run_fmu(summary, mapping, settings, progress)
    _print_result(result)
    if table is not None:
        table.finish(result)
        typer.echo(f"table: {out}")
    if plot is not None:
        from fieldlink.lab.fmu.pictures import run_figure
        from fieldlink.pictures import save

        save(run_figure(result), plot)
        typer.echo(f"picture: {plot}")
    if result.failure is not None:
        from fieldlink.lab.fmu import FmuError

        raise FmuError(f"it ended early, at {result.time[-1]:g} s: {result.failure}")


def _drivable(
    summary: FmuSummary, mapping: FmuMap, sizes: dict[str, float]
) -> dict[str, dict[str, float]]:
    """Names that a column of the inputs may have, with the words that stand for their values.

    They are the mapped tags, and the inputs that are not mapped.
    """
    from fieldlink.lab.fmu.signals import Signals, words_of

    signals = Signals(summary, mapping, {**mapping.parameters, **sizes}, ())
    return {
        tag: words_of(summary.variable(entry.variable)) for tag, entry in signals.inputs.items()
    }


class _Progress:
    """The second that was reached: a live line on a terminal, else a line every half minute."""

    _SECONDS = 30.0

    def __init__(self, name: str, stop: float | None = None) -> None:
        self._name = name
        self._of = "" if stop is None else f" of {stop:g} s"
        self._status: Any = None
        self._shown = time.monotonic()

    def __enter__(self) -> _Progress:
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status(f"{self._name}: starting")
            self._status.start()
        return self

    def __call__(self, moment: float) -> None:
        self._show(f"{self._name}: {moment:g} s{self._of}")

    def count(self, done: int, of: int) -> None:
        """Show how many runs are done."""
        self._show(f"{self._name}: {done} of {of} runs")

    def _show(self, text: str) -> None:
        if self._status is not None:
            self._status.update(text)
        elif time.monotonic() > self._shown + self._SECONDS:
            self._shown = time.monotonic()
            typer.echo(text, err=True)

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()


def _print_result(result: RunResult) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from fieldlink.cli.tables import number

    console = Console()
    for note in result.notes:
        console.print(f"[yellow]note[/yellow] {escape(note)}", highlight=False)
    table = Table(header_style="bold", box=None, pad_edge=False, title=result.model)
    for column in ("tag", "unit", "at the start", "at the end", "lowest", "highest"):
        table.add_column(column)
    for tag, values in list(result.columns.items())[:_MOST_ROWS]:
        numbers = (values[0], values[-1], values.min(), values.max())
        table.add_row(escape(tag), result.units[tag], *map(number, map(float, numbers)))
    console.print(table)
    span = result.time[-1] - result.time[0]
    late = f", {result.late} steps late" if result.late else ""
    console.print(
        f"{result.time.size - 1} steps, {span:g} s of the plant in {result.seconds:.2f} s{late}"
    )
    if result.ended is not None:
        console.print(f"ended in order at {result.time[-1]:g} s: {escape(result.ended)}")


@app.command("sweep")
def sweep(
    fmu: FmuFile,
    out: Annotated[Path, typer.Option(help="The table, one row a run: .csv or .parquet.")],
    grid: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=V[,V...]", help="Values to combine."),
    ] = None,
    random: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LOW:HIGH", help="Draw the value evenly from a range, for each run."
        ),
    ] = None,
    latin: Annotated[
        bool, typer.Option("--latin", help="Draw --random values as a Latin hypercube.")
    ] = False,
    runs: Annotated[int, typer.Option(min=1, help="Runs for each combination of values.")] = 1,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Samples of a run; else 2000, or the experiment's.")
    ] = None,
    step: Annotated[float | None, typer.Option(help="Seconds a step.")] = None,
    kind: Annotated[str | None, typer.Option(help='"co-simulation" or "model exchange".')] = None,
    seed: Annotated[int, typer.Option(help="Seed of the whole sweep.")] = 1,
    loop: Annotated[int, typer.Option(min=1, help="Loop of a plant that has several.")] = 1,
    workers: Annotated[
        int | None,
        typer.Option(
            min=0, help="Runs side by side; 0 runs them one by one, one a core unless given."
        ),
    ] = None,
    signals: Annotated[
        bool, typer.Option("--signals", help="Keep the signals too (Parquet).")
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds that a step may take.")] = 60.0,
) -> None:
    """Run a plant, or any FMU, many times; goes on where it was interrupted."""
    from fieldlink.lab.fmu.sweeping import plan_steps, sweep_to_file
    from fmu_models import Sweep, catalogue, summarise

    ours = str(fmu) in catalogue and not fmu.exists()
    values = {name: _list_of(text, "--set") for name, text in _pairs(grid or [], "--set")}
    if ours:
        count, period = steps or _CATALOGUE_STEPS, step
    else:
        count, period = plan_steps(summarise(fmu), steps, step)
    plan = Sweep(
        str(fmu),
        steps=count,
        grid={name: many for name, many in values.items() if len(many) > 1},
        fixed={name: many[0] for name, many in values.items() if len(many) == 1},
        random={name: _range_of(text) for name, text in _pairs(random or [], "--random")},
        runs=runs,
        seed=seed,
        loop=loop - 1,
        design="latin" if latin else "random",
        period=period,
        kind=kind,
        timeout=timeout,
    )
    with _Progress(fmu.stem) as progress:
        failed = sweep_to_file(plan, out, signals=signals, workers=workers, progress=progress.count)
    typer.echo(f"{plan.count} runs, {len(failed)} failed: {out}")
    for number, error in failed[:_MOST_ROWS]:
        typer.echo(f"  run {number}: {error}", err=True)
    if len(failed) > _MOST_ROWS:
        typer.echo(f"  and {len(failed) - _MOST_ROWS} more in the column error", err=True)
    if failed:
        raise typer.Exit(1)


def _pairs(texts: list[str], option: str) -> list[tuple[str, str]]:
    pairs = [text.partition("=") for text in texts]
    for text, (name, sign, value) in zip(texts, pairs, strict=True):
        if not (name and sign and value):
            raise typer.BadParameter(f"{text!r} is not NAME=VALUES", param_hint=option)
    return [(name, value) for name, _, value in pairs]


def _list_of(text: str, option: str, separator: str = ",") -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(separator))
    except ValueError:
        raise typer.BadParameter(f"{text!r} are not numbers", param_hint=option) from None


def _range_of(text: str) -> tuple[float, float]:
    bounds = _list_of(text, "--random", ":")
    if len(bounds) != 2:
        raise typer.BadParameter(f"{text!r} is not LOW:HIGH", param_hint="--random")
    return bounds[0], bounds[1]


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
        Path | None, typer.Option(help="The scenario; else NAME.toml in this folder.")
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="Seconds of a scan; else the FMU's step, or a tenth of its lag."),
    ] = None,
    op_start: Annotated[
        float | None, typer.Option(help="Input at the start, percent; else its start value.")
    ] = None,
    stick_band: Annotated[float, typer.Option(min=0.0, help="S of the valve, % of OP.")] = 5.0,
    slip_jump: Annotated[float, typer.Option(min=0.0, help="J of the valve, % of OP.")] = 1.5,
) -> None:
    """Put a process of your own into a loop with a sticky valve: a scenario to rehearse."""
    from fieldlink.lab.fmu.loop_scenario import LoopWish, respond, write_scenario
    from fmu_models import summarise

    summary = summarise(_file(fmu))
    wish = LoopWish(op, pv, period, op_start, stick_band, slip_jump)
    response = respond(summary, wish)
    gain, integral_time = response.tune()
    file = output or Path(f"{fmu.stem}.toml")
    write_scenario(summary, wish, response, file)
    kind = "rises by" if response.integrates else "changes by"
    unit = " a second" if response.integrates else ""
    typer.echo(
        f"{pv} {kind} {response.gain:.3g}{unit} for each percent of {op}, "
        f"lag {response.lag:.3g} s, dead time {response.dead_time:.3g} s; "
        f"scan every {response.period:g} s"
    )
    typer.echo(f"PI by SIMC: gain {gain:.3g}, integral time {integral_time:.3g} s")
    typer.echo(f"{file}: fieldlink rehearse {file} --report report")
