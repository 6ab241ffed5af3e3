"""``report.html``: the ranking with a trend for each loop, and the errors; no script, one file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import Cut, Job
from fieldlink.assess.run_file import Counts, RunFile
from fieldlink.assess.trends import Trend, after_repair, thirty_days, trend_of
from fieldlink.unfinished_file import write_whole

__all__ = ["write_page"]

LOOPS_SHOWN = 500
"""More than a team works through; the tables have the rest, and the page stays below 2 MB."""

ERRORS_SHOWN = 200

WINDOWS_DRAWN = 400
"""Of a loop, the newest: more than a year of days, more than the picture has pixels."""

CLASSES = (
    "loops whose valve sticks: in at least half of their judged windows, or in each of the newest",
    "loops whose valve sticks in fewer of them",
    "loops whose valve stuck and no longer does in the newest three judged windows",
    "loops without stiction",
    "loops no window of which could show stiction",
    "loops with errors only",
)
"""In the order of the ranking of `RunFile`."""


@dataclass(frozen=True, slots=True)
class _Loop:
    """A line of the ranking, as it is shown."""

    rank: int
    name: str
    file: str
    span: str
    sticky: int
    judged: int
    windows: int
    score: str
    band: str
    seen: str
    slope: str
    cause: str
    action: str
    trend: Trend | None


def write_page(run_file: RunFile, job: Job, counts: Counts, target: Path) -> None:
    """Write the page; the run file is ranked.

    Raises:
        AssessError: it cannot be written.
    """
    from jinja2 import Environment, PackageLoader

    classes = run_file.classes()
    environment = Environment(loader=PackageLoader("fieldlink.assess"), autoescape=True)
    text = environment.get_template("report.html.j2").render(
        loops=sum(classes.values()),
        rows=counts.rows,
        errors=counts.errors,
        places=[place.shown for place in job.places],
        cut=_cut_in_words(job.cut),
        standing=[(name, classes.get(number, 0)) for number, name in enumerate(CLASSES)],
        ranked=[
            _loop(rank, found, run_file.windows_of(found["history"], found["loop"], WINDOWS_DRAWN))
            for rank, found in enumerate(run_file.ranked_loops(LOOPS_SHOWN), start=1)
        ],
        failed=run_file.errors(ERRORS_SHOWN),
        confidence=f"{job.judging.confidence:.0%}",
        counted=_counted,
    )
    try:
        write_whole(target, text.encode())
    except OSError as error:
        raise AssessError(
            f"{target} cannot be written ({error.strerror}); check the folder and the free space, "
            "and go on with the same command"
        ) from error


def _loop(rank: int, found: Mapping[str, Any], windows: Sequence[Mapping[str, Any]]) -> _Loop:
    sticky = [row for row in windows if row["verdict"] == "stiction"]
    judged = [row for row in windows if row["verdict"] is not None]
    last = judged[-1] if judged else None
    days = [day for row in judged if (day := _day(row))]
    more = found["files"] - 1
    return _Loop(
        rank=rank,
        name=found["loop"] or "",
        file=found["file"] + (f" and {_counted(more, 'more file')}" if more else ""),
        span=" to ".join(dict.fromkeys((days[0], days[-1]))) if days else "",
        sticky=found["sticky"] or 0,
        judged=found["judged"] or 0,
        windows=found["verdicts"] + found["errors"],
        score=_number(found["score"]),
        band=_band(sticky[-1]) if sticky else "",
        seen=_day(sticky[-1]) if sticky and last is not sticky[-1] else "",
        slope=_slope(after_repair(windows)),
        cause="" if last is None else last["cause"].replace("_", " "),
        action="" if last is None else last["action"],
        trend=trend_of(windows),
    )


def _band(row: Mapping[str, Any]) -> str:
    value, low, high = (row[f"stick_band{end}"] for end in ("", "_low", "_high"))
    return f"{_number(value)} [{_number(low)}, {_number(high)}]"


def _day(row: Mapping[str, Any]) -> str:
    """The day of a window; empty in a recording without dates."""
    return str(row["start"][:10]) if row["start"].endswith("Z") else ""


def _slope(windows: Sequence[Mapping[str, Any]]) -> str:
    dated = [
        (datetime.fromisoformat(row["start"]).timestamp(), row["stick_band"])
        for row in windows
        if row["verdict"] == "stiction" and _day(row) and row["stick_band"] is not None
    ]
    slope = thirty_days(np.array(dated).reshape(-1, 2))
    return "" if slope is None else f"{slope[0]:+.3g} [{slope[1]:+.3g}, {slope[2]:+.3g}]"


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.3g}"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _cut_in_words(cut: Cut) -> str:
    from fieldlink.assess.table_row import moment_text

    words = [f"windows of at most {cut.samples} samples"]
    if cut.every is not None:
        words.append(f"one every {cut.every:g} s")
    for name, moment in (("from", cut.since), ("until", cut.until)):
        if moment is not None:
            words.append(f"{name} {moment_text(moment, dated=True)}")
    return ", ".join(words)
