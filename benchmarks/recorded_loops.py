"""Recorded and labelled loops: the verdict on every window, and how well the score ranks them.

    python -m benchmarks.recorded_loops [--data FOLDER] [--out docs/benchmarks]

Nothing of the estimator was chosen by these windows. A label is an opinion, so windows come in
three classes: *agreed*; *disputed*, shown and not scored; *not assessable*, where OP or PV stands
at one end of its range for most of the time and no label can be right. The windows of one loop are
alike, so the area under the ROC curve is given over windows and over loops, a loop with the median
of its windows' scores, and its interval comes from drawing whole loops again. Horch's
cross-correlation and the index of the plant's own tool, where there is one, are the floors.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.recorded import DATA, Judged, Labelled, judged, labelled_loops
from benchmarks.report import heading, keep, machine, table
from benchmarks.roc import auc
from estimator import EstimatorError, warm_up
from estimator.monitoring.indices import cross_correlation

__all__ = ["Area", "area_of", "class_of", "main"]

Array = NDArray[np.float64]

DISPUTED = ("plant_14.csv", "plant_15.csv")
"""Set-point steps of an under-damped level, without plateau or jump, yet labelled stiction."""

ISDB_PERIODS = {"PAP9.csv": 5.0, "CHEM13.csv": 20.0, "CHEM29.csv": 60.0}
"""Seconds between samples, as published; the others of the data base: 1."""

RAIL_ZONE = 0.01
"""Share of a signal's span that counts as its end: noise and resolution of a transmitter."""

AT_ONE_END = 0.5
"""Share of samples at one end above which a signal stands still or at a rail: a majority."""

DRAWS = 2000
"""Resamplings of the loops; the interval's own error is then about a hundredth of its width."""


LEAST_LOOPS = 3
"""Loops of each label below which drawing them again says nothing: one or two are always alike."""


@dataclass(frozen=True, slots=True)
class Area:
    """Area under the ROC curve, NaN where a label is missing, with its 90 % interval.

    The interval is NaN where there are too few loops to draw again.
    """

    value: float
    low: float
    high: float
    sticky: int
    healthy: int


def _share_at_ends(signal: Array) -> float:
    """Share of samples in the zone at the lowest or at the highest value, the larger of both."""
    zone = RAIL_ZONE * float(np.ptp(signal))
    low, high = signal <= signal.min() + zone, signal >= signal.max() - zone
    return float(max(low.mean(), high.mean()))


def class_of(window: Labelled) -> str:
    """``agreed``, ``disputed`` or ``not assessable``, from the samples and not from a verdict."""
    if window.file in DISPUTED:
        return "disputed"
    op, pv = window.op[np.isfinite(window.op)], window.pv[np.isfinite(window.pv)]
    at_an_end = max(_share_at_ends(op), _share_at_ends(pv))
    return "not assessable" if at_an_end > AT_ONE_END else "agreed"


def area_of(scores: Sequence[float], sticky: Sequence[bool], loops: Sequence[str]) -> Area:
    """Area over the given items, its interval by drawing ``loops`` again with all their items.

    A score that is NaN counts as the lowest.
    """
    score = np.where(np.isnan(scores), -np.inf, np.asarray(scores, dtype=np.float64))
    label, names = np.asarray(sticky, dtype=np.bool_), np.asarray(loops)
    count = int(label.sum())
    if count in (0, label.size):
        return Area(math.nan, math.nan, math.nan, count, label.size - count)
    value = auc(score, label)
    fewest = min(np.unique(names[label]).size, np.unique(names[~label]).size)
    if fewest < LEAST_LOOPS:
        return Area(value, math.nan, math.nan, count, label.size - count)
    rng = np.random.default_rng(0)
    members = [np.flatnonzero(names == name) for name in dict.fromkeys(loops)]
    drawn = []
    for _ in range(DRAWS):
        rows = np.concatenate([members[i] for i in rng.integers(0, len(members), len(members))])
        if 0 < label[rows].sum() < rows.size:
            drawn.append(auc(score[rows], label[rows]))
    low, high = np.quantile(drawn, [0.05, 0.95])
    return Area(value, float(low), float(high), count, label.size - count)


def _per_loop(
    scores: Sequence[float], sticky: Sequence[bool], loops: Sequence[str]
) -> tuple[list[float], list[bool], list[str]]:
    names = list(dict.fromkeys(loops))
    rows = [[i for i, name in enumerate(loops) if name == wanted] for wanted in names]
    medians = [float(np.median([scores[i] for i in part])) for part in rows]
    return medians, [any(sticky[i] for i in part) for part in rows], names


def _horch(window: Labelled) -> float:
    try:
        return cross_correlation(window.op, window.pv).height_asymmetry
    except EstimatorError:
        return math.nan


def _low(values: Sequence[float]) -> list[float]:
    """Values with the lowest in place of NaN."""
    known = [value for value in values if not math.isnan(value)]
    least = min(known, default=0.0) - 1.0
    return [least if math.isnan(value) else value for value in values]


def _areas(judgements: Sequence[Judged]) -> dict[str, dict[str, Area]]:
    fair = [one for one in judgements if class_of(one.window) == "agreed"]
    scores = {
        "ours": [one.result.score for one in fair],
        "Horch": [_horch(one.window) for one in fair],
        "the plant's index": [one.window.index for one in fair],
    }
    found: dict[str, dict[str, Area]] = {}
    for name, given in scores.items():
        rows = [i for i, value in enumerate(given) if value is not None]
        if not rows:
            continue
        values = _low([float(given[i] or 0.0) for i in rows])
        sticky = [fair[i].is_sticky for i in rows]
        loops = [fair[i].window.loop for i in rows]
        found[name] = {
            "windows": area_of(values, sticky, loops),
            "loops": area_of(*_per_loop(values, sticky, loops)),
        }
    return found


def _area_rows(areas: dict[str, dict[str, Area]]) -> list[tuple[Any, ...]]:
    return [
        (name, over, area.sticky, area.healthy, area.value, area.low, area.high)
        for name, both in areas.items()
        for over, area in both.items()
    ]


def _is_uncertain(one: Judged) -> bool:
    return bool(getattr(one.result, "uncertain", False))


def _tally(name: str, judgements: Sequence[Judged]) -> tuple[Any, ...]:
    fair = [one for one in judgements if one.is_assessable]
    sure = [one for one in fair if not _is_uncertain(one)]
    wrong = [one for one in sure if not one.is_right]
    return (
        name,
        len(judgements),
        sum(not one.is_sticky for one in wrong),
        sum(one.is_sticky for one in wrong),
        len(fair) - len(sure),
        len(judgements) - len(fair),
    )


def _row(one: Judged) -> tuple[Any, ...]:
    w, r = one.window, one.result
    verdict = r.verdict.value + (" (uncertain)" if _is_uncertain(one) else "")
    if not one.is_assessable:
        verdict = "not assessable: " + ", ".join(reason.code.value for reason in r.reasons)
    elif not one.is_right and class_of(w) == "agreed":
        verdict = f"**{verdict}**"
    s, j = r.stick_band, r.slip_jump
    numbers = (s.value, s.low, s.high, j.value, j.low, j.high)
    index = math.nan if w.index is None else w.index
    return (
        w.file,
        w.loop,
        w.kind,
        w.label,
        class_of(w),
        verdict,
        r.score,
        *numbers,
        _horch(w),
        index,
    )


def _report(name: str, judgements: Sequence[Judged]) -> tuple[str, dict[str, Any]]:
    classes = ("agreed", "disputed", "not assessable")
    tallies = [_tally(c, [x for x in judgements if class_of(x.window) == c]) for c in classes]
    areas = _areas(judgements)
    text = "\n\n".join(
        [
            f"## {name}",
            table(("class", "windows", "accused", "missed", "uncertain", "declined"), tallies),
            table(("score", "over", "sticky", "healthy", "area", "5 %", "95 %"), _area_rows(areas)),
            table(
                (
                    *("file", "loop", "type", "label", "class", "verdict", "score"),
                    *("S", "S 5 %", "S 95 %", "J", "J 5 %", "J 95 %", "Horch", "plant's index"),
                ),
                [_row(one) for one in judgements],
            ),
        ]
    )
    figures = {
        "classes": [list(row) for row in tallies],
        "areas": {k: {over: asdict(a) for over, a in both.items()} for k, both in areas.items()},
        "windows": [one.to_dict() | {"class": class_of(one.window)} for one in judgements],
    }
    return text, figures


def _with_periods(windows: Sequence[Labelled]) -> list[Labelled]:
    return [replace(w, period_s=ISDB_PERIODS.get(w.file, w.period_s)) for w in windows]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the labelled loops")
    parser.add_argument("--out", type=Path, help="folder for recorded_loops.md and .json")
    options = parser.parse_args(arguments)
    parts = [heading("recorded_loops", __doc__, arguments)]
    figures: dict[str, Any] = {"machine": machine()}
    everything: list[Judged] = []
    warm_up()
    for collection, name in (("plant", "Refinery windows"), ("isdb", "ISDB loops")):
        if not (options.data / f"{collection}_labels.csv").is_file():
            parts.append(f"## {name}\n\nSkipped: no {collection}_labels.csv in {options.data}.")
            continue
        judgements = judged(_with_periods(labelled_loops(options.data, collection)))
        text, figures[collection] = _report(name, judgements)
        parts.append(text)
        everything += judgements
    if everything:
        areas = _areas(everything)
        header = ("score", "over", "sticky", "healthy", "area", "5 %", "95 %")
        parts.append(f"## All together\n\n{table(header, _area_rows(areas))}")
        figures["all"] = {
            k: {over: asdict(a) for over, a in both.items()} for k, both in areas.items()
        }
    print("\n\n".join(parts))
    keep(options.out, "recorded_loops", "\n\n".join(parts), figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
