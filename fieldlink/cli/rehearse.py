"""``fieldlink rehearse``: scenarios in virtual time, judged by what they expect."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from fieldlink.lab.rehearse import Defect, Rehearsal, ScenarioFile

__all__ = ["rehearse"]


def _complete_scenario(incomplete: str) -> list[str]:
    # The package itself would be imported at every tabulator key.
    shipped = files("fieldlink.lab") / "rehearse" / "scenarios"
    names = (entry.name for entry in shipped.iterdir())
    return sorted(n.removesuffix(".toml") for n in names if n.startswith(incomplete))


def rehearse(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SCENARIO",
            help="Names of shipped scenarios or paths of your own; without any they are listed.",
            autocompletion=_complete_scenario,
        ),
    ] = None,
    run_all: Annotated[bool, typer.Option("--all", help="Run every shipped scenario.")] = False,
    inject: Annotated[
        str | None,
        typer.Option(metavar="DEFECT", help="Break something on purpose; 'list' shows what."),
    ] = None,
    self_test: Annotated[
        bool,
        typer.Option("--self-test", help="Also run with each defect that must make it fail."),
    ] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write an HTML report with pictures.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON only.")] = False,
) -> None:
    """Rehearse what may happen in a plant, before going there. Exit status 1: not as expected."""
    import logging

    from fieldlink.cli.tables import data_console
    from fieldlink.daemon import configure_logging
    from fieldlink.lab.rehearse import find_scenario, load_scenario, shipped_scenarios

    configure_logging(logging.ERROR)
    console = data_console(highlight=False)
    if inject == "list":
        _list_defects(console)
        return
    defect = _defect(inject)
    if self_test and defect is not None:
        raise typer.BadParameter("runs with defects of its own", param_hint="--self-test")
    paths = list(shipped_scenarios()) if run_all else []
    paths += [find_scenario(name) for name in scenarios or ()]
    if not paths:
        if defect is not None or self_test or report is not None:
            raise typer.BadParameter("name one, or give --all", param_hint="SCENARIO")
        _list([load_scenario(path) for path in shipped_scenarios()], console, as_json)
        return
    # All of them before the first: a slip in the last must not cost the run of the others.
    files = [load_scenario(path) for path in paths]
    untested = [file.name for file in files if not file.scenario.scenario.defects]
    if self_test and untested:
        raise typer.BadParameter(
            f"{', '.join(untested)} names no defect that must make it fail; add defects = [...] "
            "below [scenario] (--inject list)",
            param_hint="--self-test",
        )
    runs = [
        run for file in files for run in _runs(file, defect, self_test, report, console, as_json)
    ]
    if as_json:
        documents = [run.to_dict() for run in runs]
        typer.echo(json.dumps(documents if len(runs) > 1 else documents[0], allow_nan=False))
    elif len(runs) > 1:
        _summary(runs, self_test, console)
    if not all(_as_it_should(run, self_test) for run in runs):
        raise typer.Exit(1)


def _runs(
    file: ScenarioFile,
    inject: Defect | None,
    self_test: bool,
    report: Path | None,
    console: Console,
    as_json: bool,
) -> list[Rehearsal]:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from fieldlink.lab.rehearse import rehearse as run_scenario

    if report is not None:  # before the run: a library that is missing must not cost it
        from fieldlink.lab.rehearse.report import write_report

    defects = (inject, *(file.scenario.scenario.defects if self_test else ()))
    done = []
    for defect in defects:
        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True, disable=as_json) as bar:
            said = file.name if defect is None else f"{file.name} with {defect}"
            task = bar.add_task(said, total=1.0)
            run = run_scenario(
                file,
                inject=defect,
                progress=lambda share: bar.update(task, completed=share),  # noqa: B023
            )
        done.append(run)
        if not as_json:
            _print(run, console)
        if report is not None:
            several = file.name if defect is None else f"{file.name}-{defect}"
            written = write_report(run, report / several)
            if not as_json:
                console.print(f"report: {written}")
    return done


def _as_it_should(run: Rehearsal, self_test: bool) -> bool:
    """In a self-test a run with a defect has to fail."""
    return run.passed == (run.defect is None) if self_test else run.passed


def _print(run: Rehearsal, console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    summary = run.file.scenario.scenario
    console.print(Text(f"{run.file.name}: {summary.title}", style="bold"))
    if run.defect is not None:
        console.print(Text(f"with a defect: {run.defect.text}", style="yellow"))
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    table.add_column("expected", ratio=1)
    table.add_column("found", ratio=1)
    for finding in run.findings:
        table.add_row(_mark(finding.passed), Text(finding.expected), Text(finding.found))
    console.print(table)
    speed = summary.duration / run.seconds
    said = f"{summary.duration:g} plant seconds in {run.seconds:.1f} s, {speed:.0f} times real time"
    console.print(_mark(run.passed), Text(said, style="dim"))
    console.print()


def _summary(runs: Sequence[Rehearsal], self_test: bool, console: Console) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in ("scenario", "defect", "outcome", "as it should be"):
        table.add_column(head)
    for run in runs:
        table.add_row(
            run.file.name, run.defect or "-", _mark(run.passed), _yes(_as_it_should(run, self_test))
        )
    console.print(table)


def _mark(passed: bool) -> Text:
    from rich.text import Text

    return Text("passed", style="green") if passed else Text("failed", style="red")


def _yes(good: bool) -> Text:
    from rich.text import Text

    return Text("yes") if good else Text("no", style="red")


def _list(files: Sequence[ScenarioFile], console: Console, as_json: bool) -> None:
    from rich.table import Table

    if as_json:
        listed = [{"scenario": f.name, "title": f.scenario.scenario.title} for f in files]
        typer.echo(json.dumps(listed))
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in ("scenario", "what happens"):
        table.add_column(head)
    for file in files:
        table.add_row(file.name, file.scenario.scenario.title)
    console.print(table)
    console.print("\nfieldlink rehearse NAME runs one, --all runs them all; docs: rehearse.md")


def _defect(name: str | None) -> Defect | None:
    from fieldlink.lab.rehearse import Defect

    if name is None:
        return None
    try:
        return Defect(name)
    except ValueError:
        known = ", ".join(Defect)
        raise typer.BadParameter(
            f"{name!r} is unknown; use one of: {known}", param_hint="--inject"
        ) from None


def _list_defects(console: Console) -> None:
    from rich.table import Table

    from fieldlink.lab.rehearse import Defect

    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in ("defect", "what it does"):
        table.add_column(head)
    for defect in Defect:
        table.add_row(defect, defect.text)
    console.print(table)
