"""What ``fieldlink fmu`` prints of an FMU and of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fieldlink.lab.fmu import RunResult
    from fmu_models import FmuSummary, VariableSummary

__all__ = ["MOST_ROWS", "print_result", "print_summary"]

MOST_ROWS = 40
"""Of a table on a terminal; the files have all."""
_MOST_VARIABLES = 200
"""That ``info`` shows unless asked for all: some screens full."""
_HIDDEN = ("local", "independent")


def print_summary(summary: FmuSummary, every: bool) -> None:
    """Print what an FMU is: facts, variables (``every`` one, or those of its interface), notes."""
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    from fieldlink.cli.tables import data_console, labelled

    console = data_console()
    description = summary.description or "(no description)"
    console.print(Panel(description, title=Text(summary.name), expand=False))
    stop = "not given" if summary.stop_time is None else f"{summary.stop_time:g} s"
    step = "not given" if summary.step_size is None else f"{summary.step_size:g} s"
    here = Text("" if summary.runs_here else "  (not this machine)", style="red")
    facts = Table(box=None, show_header=False, pad_edge=False)
    for name, value in (
        ("FMI", f"{summary.fmi_version}, {', '.join(summary.kinds)}"),
        ("exported by", summary.tool or "-"),
        ("libraries for", Text.assemble(", ".join(summary.platforms) or "none", here)),
        ("sources", "yes" if summary.has_sources else "no"),
        ("size", f"{summary.bytes / 1024:.0f} kB, {summary.extracted_bytes / 1024:.0f} kB open"),
        ("experiment", f"{summary.start_time:g} s to {stop}, step {step}"),
        ("snapshots", "yes" if summary.can_restore else "no"),
        ("variables", f"{len(summary.variables)}, {summary.states} continuous states"),
    ):
        facts.add_row(name, value)
    console.print(facts)
    shown = [v for v in summary.variables if every or v.causality not in _HIDDEN]
    most = len(shown) if every else _MOST_VARIABLES
    console.print(_variables_table(shown[:most]))
    hidden = sum(v.causality == "local" for v in summary.variables)
    if hidden and not every:
        console.print(f"and {hidden} local variables: --all shows them", style="dim")
    if len(shown) > most:
        console.print(f"and {len(shown) - most} more: --all shows them", style="dim")
    for warning in summary.warnings:
        console.print(labelled("note", warning))


def _variables_table(shown: Sequence[VariableSummary]) -> Any:
    from rich.table import Table

    table = Table(header_style="bold", box=None, pad_edge=False)
    for column in ("variable", "role", "type", "unit", "start", "range", "what"):
        table.add_column(column, overflow="fold")
    for v in shown:
        what = v.description
        if v.items:
            what += " (" + ", ".join(f"{value} {name}" for value, name in v.items) + ")"
        bounds = f"{v.low or '…'} to {v.high or '…'}" if v.low or v.high else ""
        role = f"{v.variability} {v.causality}" if v.causality == "parameter" else v.causality
        cells = (v.name, role, v.type, v.unit, v.start, bounds, what.strip())
        table.add_row(*cells)
    return table


def print_result(result: RunResult) -> None:
    """Print what a run did: notes, a row for each signal, how it ended."""
    from rich.table import Table

    from fieldlink.cli.tables import counted, data_console, labelled, number

    console = data_console()
    for note in result.notes:
        console.print(labelled("note", note))
    table = Table(header_style="bold", box=None, pad_edge=False, title=result.model)
    for column in ("tag", "unit", "at the start", "at the end", "lowest", "highest"):
        table.add_column(column)
    for tag, values in list(result.columns.items())[:MOST_ROWS]:
        numbers = (values[0], values[-1], values.min(), values.max())
        table.add_row(tag, result.units[tag], *map(number, map(float, numbers)))
    console.print(table)
    span = result.time[-1] - result.time[0]
    late = f", {result.late} steps late" if result.late else ""
    console.print(
        f"{counted(result.time.size - 1, 'step')}, {span:g} s of the plant "
        f"in {result.seconds:.2f} s{late}"
    )
    if result.ended is not None:
        console.print(f"ended in order at {result.time[-1]:g} s: {result.ended}")
