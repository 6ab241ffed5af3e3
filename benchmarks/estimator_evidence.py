"""The limits that the estimator must keep, and the figures that it reaches.

    python -m benchmarks.estimator_evidence --out docs/benchmarks [--images docs/images] [--quick]

Runs the estimator's benchmarks one after the other, keeps their tables and figures, and sets the
figures beside the limits. Recorded loops have no limits here: they are reported as they come out.
``--quick`` runs a few windows of each: enough to see that it works, too few to judge by. ``--read``
only reads the figures that are there.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import (
    compression,
    estimator_speed,
    industrial,
    linear_part,
    method_pictures,
    methods,
    paper,
    recorded_loops,
    report_family,
)
from benchmarks.estimator_speed import HEALTHY_LIMIT_MS, LIMIT_MS
from benchmarks.family_answers import HALF
from benchmarks.paper_summary import ORACLE, limits_of
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
            f"at most {self.high:.3g}" if math.isinf(self.low) else f"{self.low:g} to {self.high:g}"
        )


def _jobs(quick: bool) -> list[tuple[Callable[..., int], list[str]]]:
    """Every benchmark with its command line."""
    jobs = ["--jobs", str(os.cpu_count() or 1)]
    search = ["--methods", "search", "truth", "oracle", "--name", "paper_repeated"]
    auto = ["--criteria", "auto", *jobs]
    family = ["--loops", "2" if quick else "60", *jobs]
    few = ["--starts", "0"] if quick else []
    return [
        (report_family.main, family),
        (recorded_loops.main, []),
        (methods.main, ["--loops", "1" if quick else "8", *jobs]),
        (compression.main, ["--loops", "1"] if quick else []),
        (estimator_speed.main, ["--windows", "1", *few] if quick else []),
        (paper.main, ["--runs", "1" if quick else "20", *auto]),
        (paper.main, ["--runs", "2" if quick else "120", *search, *auto]),
        (industrial.main, few),
        (linear_part.main, ["--runs", "2" if quick else "20"]),
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


def _paper(figures: dict[str, Any], example: str) -> list[Criterion]:
    rows = {row["method"]: row for row in figures.get("summary", []) if row["example"] == example}
    row = rows.get("search, auto", {})
    limits = limits_of(example, _figure(rows, ORACLE, "gain"))
    return [
        Criterion(
            f"{example}: {limit.name}",
            limit.factor * _figure(row, limit.field), limit.low, limit.high, "paper_repeated",
        )
        for limit in limits
    ]  # fmt: skip


def _per_cent(hits: float, count: float) -> float:
    return 100.0 * hits / count if count else math.nan


def _wrong(counts: dict[str, Any], valve: str, wrong: str) -> float:
    """Share of wrong verdicts in per cent, an uncertain one as a half."""
    return _per_cent(counts[wrong] + HALF * counts[f"{valve}_uncertain"], counts[valve])


def _most(values: Iterable[float]) -> float:
    return max((value for value in values if not math.isnan(value)), default=math.nan)


def _least(values: Iterable[float]) -> float:
    return min((value for value in values if not math.isnan(value)), default=math.nan)


def _number(counts: dict[str, Any], name: str) -> float:
    value = counts.get(name)
    return math.nan if value is None else 100.0 * float(value)


def _family(figures: dict[str, Any]) -> list[Criterion]:
    """What the report family is held to, overall and in the worst kind."""
    kinds, laws = figures.get("kinds", {}), figures.get("laws", {})
    total = figures.get("total")
    accused, missed = ("healthy", "accused"), ("sticky", "missed")
    infinite, source = math.inf, "report_family"
    others = [counts for law, counts in laws.items() if law not in ("he", "none")]
    covered = [
        (words, [_number(counts, name) for counts in kinds.values()])
        for words, name in (("S", "band_coverage"), ("J", "jump_coverage"))
    ]

    def overall(pair: tuple[str, str]) -> float:
        return math.nan if total is None else _wrong(total, *pair)

    def worst(pair: tuple[str, str]) -> float:
        return _most(_wrong(counts, *pair) for counts in kinds.values())

    return [
        Criterion("healthy valves accused, %", overall(accused), -infinite, 2.0, source),
        Criterion("healthy accused, worst kind, %", worst(accused), -infinite, 5.0, source),
        Criterion("sticky valves missed, %", overall(missed), -infinite, 5.0, source),
        Criterion("sticky missed, worst kind, %", worst(missed), -infinite, 15.0, source),
        Criterion(
            "S, median error, He's valve, %",
            _number(laws.get("he", {}), "band_error"), -infinite, 1.0, source,
        ),
        Criterion(
            "S, median error, worst other law, %",
            _most(_number(counts, "band_error") for counts in others), -infinite, 5.0, source,
        ),
        *(
            Criterion(f"{words} in its 90 % interval, {end} kind, %", value, 80.0, 98.0, source)
            for words, values in covered
            for end, value in (("lowest", _least(values)), ("highest", _most(values)))
        ),
    ]  # fmt: skip


def _speed(figures: dict[str, Any]) -> list[Criterion]:
    kinds, infinite, source = figures.get("kinds", []), math.inf, "estimator_speed"
    healthy = [kind["mean_ms"] for kind in kinds if kind["limit_ms"] == HEALTHY_LIMIT_MS]
    every = [kind["mean_ms"] for kind in kinds]
    rivals = figures.get("rivals", [])

    def ratio(method: str) -> float:
        return _least(r["over_ours"] for r in rivals if r["method"].startswith(method))

    return [
        Criterion("core ms a window, slowest kind", _most(every), -infinite, LIMIT_MS, source),
        Criterion(
            "core ms a healthy window, slowest kind",
            _most(healthy), -infinite, HEALTHY_LIMIT_MS, source,
        ),
        Criterion("time of the grid over ours, least", ratio("grid"), 100.0, infinite, source),
        Criterion(
            "time of the optimisation over ours, least",
            ratio("optimisation"), 30.0, infinite, source,
        ),
    ]  # fmt: skip


def criteria_of(folder: Path) -> list[Criterion]:
    """Every criterion with the figure that the JSON files of ``folder`` hold."""
    repeated = _read(folder, "paper_repeated")
    rivals = [
        row
        for row in _read(folder, "paper").get("summary", [])
        if row["method"].startswith(("grid", "nlp, paper")) and row["no_worse"] is not None
    ]
    examples = [
        f"Example {number}{kind}" for kind in ("", ", constant set-point") for number in (1, 2)
    ]
    return [
        *_family(_read(folder, "report_family")),
        *[c for example in examples for c in _paper(repeated, example)],
        Criterion(
            "windows whose cost is no worse than grid's and nlp's, %, least of both",
            _least(100.0 * row["no_worse"] for row in rivals), 100.0, 100.0, "paper",
        ),
        *_speed(_read(folder, "estimator_speed")),
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and print what is met and what is not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and figures")
    parser.add_argument("--images", type=Path, help="folder for the pictures")
    parser.add_argument("--quick", action="store_true", help="judge only a few windows each time")
    parser.add_argument("--read", action="store_true", help="only read the figures in --out")
    options = parser.parse_args(arguments)
    if not options.read:
        for run, line in _jobs(options.quick):
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
