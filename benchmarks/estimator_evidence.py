"""What the estimator is held to, and what it reaches.

    python -m benchmarks.estimator_evidence --out docs/benchmarks [--images docs/images] [--quick]

Runs the estimator's benchmarks one after the other, keeps their tables and figures, and sets the
figures beside the limits. ``--quick`` runs a few windows of each: enough to see that it works, too
few to judge by. ``--read`` only reads the figures that are there.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import (
    estimator_speed,
    industrial,
    linear_part,
    method_pictures,
    paper,
    robustness,
)
from benchmarks.paper_summary import LIMITS
from benchmarks.report import heading, keep, table

__all__ = ["Criterion", "criteria_of", "main"]


@dataclass(frozen=True, slots=True)
class Criterion:
    """One figure with its limits; ``met`` is None where the figure is missing."""

    name: str
    value: float
    low: float
    high: float
    source: str

    @property
    def met(self) -> bool | None:
        """Whether the figure lies within its limits."""
        return None if math.isnan(self.value) else self.low <= self.value <= self.high

    @property
    def limit(self) -> str:
        """The limits in words."""
        if math.isinf(self.high):
            return f"at least {self.low:g}"
        return (
            f"at most {self.high:g}" if math.isinf(self.low) else f"{self.low:g} to {self.high:g}"
        )


def _jobs(quick: bool, images: Path | None) -> list[tuple[Callable[..., int], list[str]]]:
    """Every benchmark with its command line."""
    pictures = [] if images is None else ["--images", str(images)]
    compared = "1" if quick else "20"
    repeated = "2" if quick else "120"
    linear = "2" if quick else "20"
    loops = "10" if quick else "200"
    side_by_side = ["--criteria", "auto", "--jobs", str(os.cpu_count() or 1)]
    search = ["--methods", "search", "truth", "oracle", "--name", "paper_repeated"]
    return [
        (estimator_speed.main, []),
        (industrial.main, [*pictures, *(["--starts", "0"] if quick else [])]),
        (paper.main, ["--runs", compared, *side_by_side]),
        (paper.main, ["--runs", repeated, *search, *side_by_side]),
        (robustness.main, ["--runs", loops]),
        (linear_part.main, ["--runs", linear]),
    ]


def _read(folder: Path, name: str) -> dict[str, Any]:
    file = folder / f"{name}.json"
    return json.loads(file.read_text()) if file.is_file() else {}


def _figure(figures: dict[str, Any], *path: str) -> float:
    """The number at a path of keys, NaN where there is none."""
    here: Any = figures
    for key in path:
        here = here.get(key) if isinstance(here, dict) else None
    return math.nan if here is None else float(here)


def _share(figures: dict[str, Any], name: str) -> float:
    one = figures.get("summary", {}).get(name)
    return math.nan if not one or not one["count"] else 100.0 * one["hits"] / one["count"]


def _paper(figures: dict[str, Any], example: str) -> list[Criterion]:
    rows = [
        row
        for row in figures.get("summary", [])
        if row["example"] == example and row["method"] == "search, auto"
    ]
    row = rows[0] if rows else {}

    return [
        Criterion(
            f"{example}: {limit.name}",
            limit.factor * _figure(row, limit.field), limit.low, limit.high, "paper_repeated",
        )
        for limit in LIMITS
    ]  # fmt: skip


def criteria_of(folder: Path) -> list[Criterion]:
    """Every criterion with the figure that the JSON files of ``folder`` hold."""
    speed, loops = _read(folder, "estimator_speed"), _read(folder, "robustness")
    recorded, compared = _read(folder, "industrial"), _read(folder, "paper")
    repeated = _read(folder, "paper_repeated")
    rivals = [
        row
        for row in compared.get("summary", [])
        if row["method"].startswith(("grid", "nlp, paper")) and row["no_worse"] is not None
    ]
    worst = min((row["no_worse"] for row in rivals), default=math.nan)
    summary = recorded.get("summary", {})
    examples = [
        f"Example {number}{kind}" for kind in ("", ", constant set-point") for number in (1, 2)
    ]
    found = [c for example in examples for c in _paper(repeated, example)]
    slowest = max(
        (v for k, v in speed.items() if k.endswith("mean seconds a window")), default=math.nan
    )
    ours = _figure(summary, "AUC of score, assessable plant windows")
    theirs = _figure(summary, "AUC of published index, same windows")
    isdb = _figure(summary, "ISDB verdicts right") / max(_figure(summary, "ISDB loops"), 1.0)
    alarms, misses = "false alarms on healthy valves", "misses, S >= 2 % of OP, moderate noise"
    infinite = math.inf
    return [
        *found,
        Criterion(
            "windows whose cost is no worse than grid's and nlp's, %, least of both",
            100.0 * worst, 100.0, 100.0, "paper",
        ),
        Criterion(
            "time of the grid over the search's",
            _figure(speed, "grid 0.1 over search"), 100.0, infinite, "estimator_speed",
        ),
        Criterion(
            "time of nlp, M=7, over the search's",
            _figure(speed, "nlp M=7 over search"), 30.0, infinite, "estimator_speed",
        ),
        Criterion(
            "core milliseconds of a window, mean of the slowest kind",
            1e3 * slowest, -infinite, 100.0, "estimator_speed",
        ),
        Criterion("AUC of the score, plant windows", ours, 0.98, infinite, "industrial"),
        Criterion(
            "AUC less that of the published index", ours - theirs, 1e-6, infinite, "industrial"
        ),
        Criterion(
            "plant windows not assessable, %",
            _figure(summary, "plant, not assessable %"), -infinite, 15.0, "industrial",
        ),
        Criterion("ISDB verdicts right, %", 100.0 * isdb, 100.0, 100.0, "industrial"),
        Criterion("false alarms, %", _share(loops, alarms), -infinite, 3.0, "robustness"),
        Criterion("misses, %", _share(loops, misses), -infinite, 5.0, "robustness"),
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and print what is met and what is not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and figures")
    parser.add_argument("--images", type=Path, help="folder for the pictures")
    parser.add_argument("--quick", action="store_true", help="a few windows of each")
    parser.add_argument("--read", action="store_true", help="only read the figures in --out")
    options = parser.parse_args(arguments)
    if not options.read:
        for run, line in _jobs(options.quick, options.images):
            run([*line, "--out", str(options.out)])
        if options.images is not None:
            method_pictures.main(["--images", str(options.images)])
    criteria = criteria_of(options.out)
    word = {True: "yes", False: "**no**", None: "not measured"}
    rows = [
        (c.name, c.value, c.limit, word[c.met], f"[{c.source}]({c.source}.md)") for c in criteria
    ]
    body = table(("figure", "reached", "limit", "met", "from"), rows)
    text = f"{heading('estimator_evidence', __doc__, arguments)}\n\n{body}"
    print(text)
    kept = {"criteria": [{**asdict(c), "met": c.met} for c in criteria]}
    keep(options.out, "estimator_evidence", text, kept)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
