"""Tables of the command line, with Rich."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fieldlink.printable import as_printable

if TYPE_CHECKING:
    from estimator import Identification, Interval
    from estimator.result import Process

__all__ = [
    "counted",
    "data_console",
    "format_bullet",
    "identification_table",
    "interval_text",
    "labelled",
    "number",
    "process_text",
    "verdict_text",
]

_COLOUR = {"stiction": "bold red", "no_stiction": "bold green", "not_assessable": "bold yellow"}
_UNCERTAIN = "bold yellow"
_WORDS = {
    "stiction": "the valve sticks",
    "no_stiction": "no stiction in this window",
    "not_assessable": "this window cannot show stiction",
}


def data_console(**settings: Any) -> Console:
    """Return a console that prints names from outside as they are: ``[red]`` or ``:100:`` too."""
    return Console(markup=False, emoji=False, **settings)


def labelled(label: str, text: str, style: str = "yellow") -> Text:
    """Return text, from outside or not, behind a label in a style."""
    return Text.assemble((label, style), f" {as_printable(text)}")


def format_bullet(text: str, bullet: str = "•") -> Table:
    """Return text behind a bullet, its lines below each other."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_row(f"  {bullet}", Text(text))
    return table


def number(value: float, digits: int = 4) -> str:
    """Return a number for a person, a dash where there is none."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "-"


def counted(count: int, noun: str) -> str:
    """Return ``1 loop``, ``2 loops``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def interval_text(interval: Interval) -> str:
    """Return ``value  [low, high]``."""
    if math.isnan(interval.value):
        return "-"
    return f"{number(interval.value)}  [{number(interval.low)}, {number(interval.high)}]"


def verdict_text(result: Identification) -> Text:
    """Return the verdict in words and colour, with the score; both say it where it is uncertain."""
    verdict = result.verdict.value
    if result.uncertain:
        text = Text(f"{_WORDS[verdict]}, but this is uncertain", style=_UNCERTAIN)
        verdict += ", uncertain"
    else:
        text = Text(_WORDS[verdict], style=_COLOUR[verdict])
    text.append(f"   (verdict {verdict}, score {number(result.shown_score)})", style="dim")
    return text


def _runner_up_text(result: Identification) -> str:
    """The explanation that is the least behind the best one, and how far."""
    nearest = result.runners_up[0]
    return f"{nearest.explanation}; log-likelihood {number(nearest.behind, 3)} lower"


def process_text(process: Process) -> str:
    """Return the structure and its parameters with their units, without the dead time."""
    parameters = [
        _parameter_text(name, value)
        for name, value in process.parameters.items()
        if name != "dead_time"
    ]
    return f"{process.structure}: {', '.join(parameters)}" if parameters else process.structure


def _parameter_text(name: str, value: float) -> str:
    in_seconds = name == "swing_period" or name.startswith("time_constant")
    return f"{name.replace('_', ' ')} {number(value)}" + (" s" if in_seconds else "")


def _dead_time_text(process: Process) -> str:
    """Return the dead time in seconds, where it is known, and in whole samples."""
    samples = counted(process.dead_time_samples, "sample")
    seconds = process.parameters.get("dead_time", math.nan)
    return f"{number(seconds)} s ({samples})" if math.isfinite(seconds) else samples


def identification_table(result: Identification) -> Table:
    """Return what was identified: valve, process, fit, and what speaks for another answer."""
    table = Table(show_header=True, header_style="bold", box=None, pad_edge=False)
    table.add_column("quantity")
    table.add_column(f"value  [{result.confidence:.0%} interval]")
    table.add_row("stick band S", interval_text(result.stick_band))
    table.add_row("slip jump J", interval_text(result.slip_jump))
    table.add_row("static friction fS", interval_text(result.static_friction))
    table.add_row("dynamic friction fD", interval_text(result.dynamic_friction))
    table.add_row("process", process_text(result.process))
    table.add_row("gain", interval_text(result.process.gain_interval))
    table.add_row("dead time", _dead_time_text(result.process))
    fit = f"{number(result.fit.r2)}; with a healthy valve {number(result.fit.r2_healthy_valve)}"
    table.add_row("share of PV explained", fit)
    if math.isfinite(result.evidence.effect):
        effect = f"{number(result.evidence.effect, 3)} times PV's variance"
        table.add_row("effect of sticking", effect)
    if result.runners_up:
        table.add_row("next explanation", _runner_up_text(result))
    why = f": {result.criterion_reason}" if result.criterion_reason else ""
    table.add_row("criterion", f"{result.criterion}{why}")
    for sentence in result.identifiability:
        table.add_row("cannot tell", sentence)
    return table
