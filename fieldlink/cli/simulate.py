"""``fieldlink simulate PLANT``: closed-loop studies of controllers on a sticky valve."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fieldlink.lab.study.simulation import Simulation, SimulationResult

__all__ = ["simulate"]


def _changes(text: str | None, option: str) -> tuple[tuple[int, float], ...]:
    """Parse ``SAMPLE:VALUE,SAMPLE:VALUE``."""
    if not text:
        return ()
    try:
        pairs = [part.split(":") for part in text.split(",")]
        changes = tuple((int(sample), float(value)) for sample, value in pairs)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not SAMPLE:VALUE,SAMPLE:VALUE, for instance 0:50,700:60",
            param_hint=option,
        ) from None
    samples = [sample for sample, _ in changes]
    if samples != sorted(set(samples)) or samples[0] < 0:
        raise typer.BadParameter(f"{text!r}: the samples do not increase", param_hint=option)
    return changes


def _parameters(texts: list[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r} is not NAME=NUMBER, for instance noise_std=0.02",
                param_hint="--parameter",
            ) from None
    return found


def simulate(
    plant: Annotated[
        str, typer.Argument(metavar="PLANT", help="A plant of the catalogue, such as example1.")
    ],
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="pi, unaware, hybrid, embedding, knocker or two-move.",
        ),
    ] = None,
    take_over: Annotated[
        int, typer.Option(help="Sample at which the controllers under study take over.")
    ] = 600,
    samples: Annotated[int, typer.Option(help="Length of a run.")] = 1200,
    setpoint: Annotated[
        str | None, typer.Option(help="Set-point from a sample on: SAMPLE:VALUE,...")
    ] = None,
    load: Annotated[
        str | None, typer.Option(help="Load from a sample on: SAMPLE:VALUE,...")
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option("--parameter", "-p", help="NAME=VALUE of a parameter of the plant."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the plant's noise.")] = 1,
    rate: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Most that OP changes per scan; no limit unless given.",
            show_default=False,
        ),
    ] = 1e9,
    valve_error: Annotated[
        float, typer.Option(min=0.01, help="Factor on the frictions in the compensators' model.")
    ] = 1.0,
    gain_error: Annotated[
        float, typer.Option(min=0.01, help="Factor on the process gain in the compensators' model.")
    ] = 1.0,
    identified: Annotated[
        bool, typer.Option("--identified", help="Give the compensators the identified model.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG, SVG or PDF).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Study controllers on a simulated sticky valve: table, picture, JSON.

    Every run begins under the plant's own controller until the loop oscillates; at --take-over the
    controller under study gets the loop. All runs have the same noise.
    """
    from compensator import CompensatorError
    from fieldlink.lab.study.controllers import CONTROLLERS
    from fieldlink.lab.study.simulation import Simulation, SimulationError
    from fieldlink.lab.study.simulation import simulate as run

    names = tuple(controller or ("unaware", "hybrid"))
    for name in names:
        if name not in CONTROLLERS:
            raise typer.BadParameter(
                f"there is no controller {name!r}; choose from {', '.join(CONTROLLERS)}",
                param_hint="--controller",
            )
    simulation = Simulation(
        plant=plant,
        controllers=names,
        take_over=take_over,
        samples=samples,
        setpoint=_changes(setpoint, "--setpoint"),
        load=_changes(load, "--load"),
        parameters=_parameters(parameter or []),
        seed=seed,
        rate=rate or 1e9,
        valve_error=valve_error,
        gain_error=gain_error,
        identified=identified,
    )
    try:
        results = run(simulation)
    except CompensatorError as error:
        raise SimulationError(f"{plant}: {error}") from error
    if plot is not None:
        _draw(simulation, results, plot)
    if as_json:
        typer.echo(
            json.dumps(
                {"plant": plant, "controllers": [result.to_dict() for result in results]},
                allow_nan=False,
            )
        )
        return
    _print(simulation, results, plot)


def _print(simulation: Simulation, results: list[SimulationResult], plot: Path | None) -> None:
    from rich.table import Table

    from fieldlink.cli.tables import data_console

    table = Table(title=f"{simulation.plant}, take-over at sample {simulation.take_over}")
    table.add_column("controller")
    for heading in ("PV std", "rms error", "offset", "travel", "reversals", "ms p99"):
        table.add_column(heading, justify="right")

    def add(name: str, p: object, ms: float | None) -> None:
        from fieldlink.lab.study.closed_loop import Performance

        assert isinstance(p, Performance)
        share = 100.0 / p.samples
        table.add_row(
            name,
            f"{p.pv_std:.4g}",
            f"{p.rms:.4g}",
            f"{p.offset:+.3g}",
            f"{p.travel * share:.4g}",
            f"{p.reversals * share:.3g}",
            "" if ms is None else f"{ms:.3g}",
        )

    add("own, before", results[0].before, None)
    for result in results:
        slowest = None if result.milliseconds is None else result.milliseconds[1]
        add(result.controller, result.after, slowest)
    console = data_console()
    console.print(table)
    console.print(
        "own, before: the plant's own controller until the take-over; rms error: of SP - PV, with "
        "the set-point's steps; travel, reversals: of the stem, per 100 samples; ms p99: of a scan"
    )
    for result in results:
        if result.fell_back:
            console.print(f"{result.controller} fell back: {result.fell_back}")
    model = results[0].model
    if model is None:
        console.print(
            f"no valve model was identified before sample {simulation.take_over}: the compensators "
            "leave the loop alone; a later --take-over gives a longer window"
        )
    else:
        v = model.valve
        console.print(f"model used: stick band {v.stick_band:.4g}, slip jump {v.slip_jump:.4g}")
    if plot is not None:
        console.print(f"picture: {plot}")


def _draw(simulation: Simulation, results: list[SimulationResult], path: Path) -> None:
    from matplotlib.figure import Figure

    from fieldlink.pictures import MARK, OP, PV, STEM, save

    figure = Figure(figsize=(12.0, 3.2 * len(results)), layout="constrained")
    axes = figure.subplots(2 * len(results), 1, sharex=True, squeeze=False)[:, 0]
    for i, result in enumerate(results):
        upper, lower, trace = axes[2 * i], axes[2 * i + 1], result.trace
        upper.plot(trace.pv, color=PV, lw=1.0, label="PV")
        upper.plot(trace.sp, color=MARK, lw=0.9, ls="--", label="SP")
        lower.plot(trace.op, color=OP, lw=0.9, label="OP")
        lower.plot(trace.stem, color=STEM, lw=1.1, label="stem")
        upper.set_title(result.controller, fontsize="medium")
        for one in (upper, lower):
            one.axvline(simulation.take_over, color="black", lw=0.8)
            one.legend(loc="upper right", ncols=2, fontsize="small")
            one.margins(x=0.0)
    axes[-1].set_xlabel("samples")
    save(figure, path)
