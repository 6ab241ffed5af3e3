"""The tables of `robustness`: acceptance, sticky loops by group, healthy loops, and what failed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.judgement import CYCLE, Judgement, Share, coverage, relative_errors
from benchmarks.loops import FMU_PLANTS
from benchmarks.report import table

__all__ = ["STICKY_HEADER", "healthy_row", "sticky_row", "tables"]

STICKY_HEADER = (
    "sticky loops", "n", "missed %", "not assessable %", "bias S %", "IQR S %", "|error| S %",
    "|error| J, % of S", "cover S %", "cover J %",
)  # fmt: skip
"""Errors are medians over the loops with the verdict stiction, as are coverages."""

_HEALTHY_HEADER = ("healthy loops", "n", "false alarms %", "not assessable %")


def _percent(judged: Sequence[Judgement], test: Callable[[Judgement], bool]) -> float:
    return 100.0 * Share(sum(map(test, judged)), len(judged)).value


def _unknown(one: Judgement) -> bool:
    return one.verdict == "not_assessable"


def sticky_row(name: str, judged: Sequence[Judgement], *, any_physics: bool = False) -> list[Any]:
    """One row of `STICKY_HEADER`; Choudhury's valves enter its errors with ``any_physics`` only."""
    row: list[Any] = [name, len(judged)]
    row += [_percent(judged, lambda one: one.verdict == "no_stiction"), _percent(judged, _unknown)]
    found = [
        one
        for one in judged
        if one.verdict == "stiction" and (any_physics or one.loop.physics != "Choudhury")
    ]
    if not found:
        return [*row, *[math.nan] * 6]
    error = relative_errors(found)
    jump = [100.0 * abs(o.slip_jump[0] - o.loop.slip_jump) / o.loop.stick_band for o in found]
    row += [float(np.median(error)), float(np.subtract(*np.quantile(error, [0.75, 0.25])))]
    row += [float(np.median(np.abs(error))), float(np.median(jump))]
    return row + [100.0 * coverage(found, key).value for key in ("stick_band", "slip_jump")]


def healthy_row(name: str, judged: Sequence[Judgement]) -> list[Any]:
    """One row about healthy loops."""
    alarms = _percent(judged, lambda one: one.is_false_alarm)
    return [name, len(judged), alarms, _percent(judged, _unknown)]


def _kind(one: Judgement) -> str:
    return "FMU " + one.loop.plant if one.loop.plant in FMU_PLANTS else one.loop.plant


_WAYS: tuple[tuple[str, Callable[[Judgement], str]], ...] = (
    ("plant", _kind),
    ("controller", lambda one: one.loop.controller),
    ("noise", lambda one: one.loop.noise_kind),
    ("sampling", lambda one: "0.05-0.2 T" if one.loop.sampling < 0.2 else "0.2-1 T"),
)


def _groups(
    judged: Sequence[Judgement], ways: Sequence[tuple[str, Callable[[Judgement], str]]]
) -> list[tuple[str, list[Judgement]]]:
    found = []
    for name, key in ways:
        for value in sorted({key(one) for one in judged}):
            found.append((f"{name}: {value}", [one for one in judged if key(one) == value]))
    return found


def _failures(title: str, judged: Sequence[Judgement], samples: int) -> str:
    if not judged:
        return f"### {title}: none"
    rows = []
    for one in judged:
        loop = one.loop
        size = f"S {loop.stick_band:.2f} J {loop.slip_jump:.2f}"
        what = [loop.trouble] if loop.is_healthy else [loop.physics, size]
        rows.append(
            (
                loop.name,
                ", ".join((loop.plant, loop.controller, loop.noise_kind, *what)),
                f"{loop.noise:.2f}",
                f"{loop.sampling:.2f}",
                one.score,
                f"{one.fit[0]:.3f} / {one.fit[1]:.3f}",
                ", ".join(one.reasons),
            )
        )
    header = ("loop", "what it is", "noise", "sampling", "score", "fit / healthy fit", "reasons")
    window = "" if samples == 1000 else f" --samples {samples}"
    how = f"`python -m benchmarks.robustness --loop {judged[0].loop.name}{window}` shows the first."
    return f"### {title}: {len(judged)}\n\n{how}\n\n{table(header, rows)}"


def tables(judged: Sequence[Judgement], *, samples: int) -> tuple[str, dict[str, Any]]:
    """Markdown and the same as plain types."""
    every = [one for one in judged if not one.loop.is_healthy]
    healthy = [one for one in judged if one.loop.is_healthy]
    cycling = [one for one in every if one.turns >= CYCLE]
    fair = [one for one in cycling if one.loop.is_moderate and one.loop.stick_band >= 2.0]
    trusted = [
        one for one in cycling if one.verdict == "stiction" and one.loop.physics != "Choudhury"
    ]
    same = [one for one in trusted if one.loop.physics == "He"]
    figures: dict[str, Share] = {
        "false alarms on healthy valves": Share(
            sum(one.is_false_alarm for one in healthy), len(healthy)
        ),
        "misses, S >= 2 % of OP, moderate noise": Share(
            sum(one.is_missed for one in fair), len(fair)
        ),
        "not assessable, of these": Share(sum(map(_unknown, fair)), len(fair)),
        "90 % intervals of S hold it, He's valve": coverage(same, "stick_band"),
        "90 % intervals of J hold it, He's valve": coverage(same, "slip_jump"),
    }
    sticky_rows = [
        sticky_row("all", every),
        sticky_row("cycle not in the window", [o for o in every if o.turns < CYCLE]),
        sticky_row("cycle in the window", cycling),
        sticky_row("S >= 2 %, moderate noise", fair),
    ]
    for physics in sorted({one.loop.physics for one in cycling}):
        chosen = [one for one in cycling if one.loop.physics == physics]
        sticky_rows.append(sticky_row(f"valve: {physics}", chosen, any_physics=True))
    size = ("S", lambda one: "0.5-2 %" if one.loop.stick_band < 2.0 else "2-10 %")
    sticky_rows += [sticky_row(*group) for group in _groups(cycling, (*_WAYS, size))]
    healthy_rows = [healthy_row("all", healthy)]
    trouble = ("trouble", lambda one: one.loop.trouble)
    healthy_rows += [healthy_row(*group) for group in _groups(healthy, (trouble, *_WAYS))]
    failed = {
        "False alarms": [one for one in healthy if one.is_false_alarm],
        "S >= 2 %, moderate noise, not found": [o for o in fair if o.is_missed or _unknown(o)],
        "Other misses": [one for one in cycling if one.is_missed and one not in fair],
    }
    text = "\n\n".join(
        (
            table(("figure", "share (90 % interval)"), [(k, str(v)) for k, v in figures.items()]),
            table(STICKY_HEADER, sticky_rows),
            table(_HEALTHY_HEADER, healthy_rows),
            *(_failures(title, chosen, samples) for title, chosen in failed.items()),
        )
    )
    return text, {
        "summary": {k: {"hits": v.hits, "count": v.count} for k, v in figures.items()},
        "sticky": [dict(zip(STICKY_HEADER, row, strict=True)) for row in sticky_rows],
        "healthy": [dict(zip(_HEALTHY_HEADER, row, strict=True)) for row in healthy_rows],
        "failed": {title: [o.loop.name for o in chosen] for title, chosen in failed.items()},
    }
