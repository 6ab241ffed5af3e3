"""A picture of a run of an FMU: one row of axes for each unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from fieldlink.lab.fmu.recorder import RunResult

__all__ = ["run_figure"]

_MOST_CURVES = 12


def run_figure(result: RunResult) -> Figure:
    """Draw every column over time, those of one unit together; inputs are steps."""
    groups: dict[str, list[str]] = {}
    for tag in result.columns:
        groups.setdefault(result.units[tag], []).append(tag)
    figure = Figure(figsize=(11.0, 1.2 + 2.4 * len(groups)), layout="constrained")
    axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    for row, (unit, tags) in zip(axes, groups.items(), strict=True):
        for tag in tags[:_MOST_CURVES]:
            values = result.columns[tag]
            style = "steps-post" if tag in result.inputs else "default"
            row.plot(result.time, values, lw=1.0, drawstyle=style, label=tag)
        more = f" (+{len(tags) - _MOST_CURVES})" if len(tags) > _MOST_CURVES else ""
        row.set_ylabel((unit or "value") + more)
        row.legend(loc="upper right", ncols=4, fontsize="small")
        row.margins(x=0.0)
    axes[-1].set_xlabel("time / s")
    figure.suptitle(result.model)
    return figure
