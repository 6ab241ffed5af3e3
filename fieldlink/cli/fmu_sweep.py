"""``fieldlink fmu sweep``: run a plant, or any FMU, many times."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.fmu_progress import FmuProgress
from fieldlink.cli.fmu_tables import MOST_ROWS
from fieldlink.cli.outputs import refuse_folder

if TYPE_CHECKING:
    from fmu_models import FmuSummary, StartValue

__all__ = ["sweep"]

_CATALOGUE_STEPS = 2000


def sweep(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An .fmu file, or a plant's name.")],
    out: Annotated[Path, typer.Option(help="The table, one row a run: .csv or .parquet.")],
    grid: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=V[,V...]", help="Values to combine."),
    ] = None,
    random: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Range of a value drawn for each run."),
    ] = None,
    latin: Annotated[
        bool, typer.Option("--latin", help="Draw --random as a Latin hypercube.")
    ] = False,
    runs: Annotated[
        int, typer.Option(min=1, help="Runs of each combination, each with other noise.")
    ] = 1,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Samples of a run; else 2000, or the experiment's.")
    ] = None,
    step: Annotated[float | None, typer.Option(help="Seconds a step.")] = None,
    kind: Annotated[str | None, typer.Option(help='"co-simulation" or "model exchange".')] = None,
    seed: Annotated[int, typer.Option(help="Seed of the whole sweep.")] = 1,
    loop: Annotated[int, typer.Option(min=1, help="Which loop, in a plant with several.")] = 1,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Runs side by side; 0 for none, else the cores.")
    ] = None,
    signals: Annotated[
        bool, typer.Option("--signals", help="Keep the signals too (Parquet).")
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds that a step may take.")] = 60.0,
) -> None:
    """Run a plant, or any FMU, many times; after an interruption the same command goes on.

    The exit status is 1 when a run failed; its row says why.
    """
    from fieldlink.lab.fmu.sweeping import plan_steps, sweep_to_file
    from fmu_models import Sweep, catalogue, fmu_path, summarise

    ours = str(fmu) in catalogue and not os.path.exists(fmu)
    summary = summarise(fmu_path(str(fmu)) if ours else fmu)
    refuse_folder(out)
    values = {name: _values_of(name, text, summary) for name, text in _pairs(grid or [], "--set")}
    if ours:
        count, period = steps or _CATALOGUE_STEPS, step
    else:
        count, period = plan_steps(summary, steps, step)
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
    with FmuProgress(fmu.stem) as progress:
        failed = sweep_to_file(plan, out, signals=signals, workers=workers, progress=progress.count)
    typer.echo(f"{plan.count} runs, {len(failed)} failed: {out}")
    for number, error in failed[:MOST_ROWS]:
        typer.echo(f"  run {number}: {error}", err=True)
    if len(failed) > MOST_ROWS:
        typer.echo(f"  and {len(failed) - MOST_ROWS} more in the column error", err=True)
    if failed:
        raise typer.Exit(1)


def _pairs(texts: list[str], option: str) -> list[tuple[str, str]]:
    pairs = [text.partition("=") for text in texts]
    for text, (name, sign, value) in zip(texts, pairs, strict=True):
        if not (name and sign and value):
            raise typer.BadParameter(f"{text!r} is not NAME=VALUES", param_hint=option)
    return [(name, value) for name, _, value in pairs]


def _values_of(name: str, text: str, summary: FmuSummary) -> tuple[StartValue, ...]:
    from fieldlink.lab.fmu.start_text import read_start_value

    try:
        return tuple(read_start_value(summary, name, part) for part in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{name}: {error}", param_hint="--set") from None


def _range_of(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not LOW:HIGH", param_hint="--random") from None
