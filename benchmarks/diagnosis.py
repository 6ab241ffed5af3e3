"""Diagnosis: why loops swing, and which one started it.

Single loops of every cause and of pairs of causes, and events of whole plants, all simulated by a
family of its own that chose none of the program's numbers (``benchmarks.diagnosis_families``); and
recorded loops, where they are present. "First" is the heaviest cause, or the likeliest source.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.diagnosis_families import report, tuning
from benchmarks.diagnosis_families.records import CAUSES, SOURCES
from benchmarks.report import heading, keep, table
from fieldlink.diagnosis import LoopSignals, detect_oscillation, diagnose, find_groups
from fieldlink.diagnosis import read_controller as read

PAIRS = (
    ("sticky_valve", "external_oscillation"), ("sticky_valve", "slow_tuning"),
    ("external_oscillation", "slow_tuning"), ("saturation", "external_oscillation"),
    ("tight_tuning", "sensor"), ("slow_tuning", "saturation"),
)  # fmt: skip
FAMILIES: dict[str, Any] = {"report": report, "tuning": tuning}


def judge_loop(job: tuple[tuple[str, ...], int], family: str) -> dict[str, Any]:
    """The diagnosis of one loop, and the truth."""
    causes, seed = job
    loop = FAMILIES[family].draw_loop(causes, seed)
    begun = process_time()
    found = diagnose(loop.op, loop.pv, loop.sp, auto=loop.auto, period=loop.period)
    seconds = process_time() - begun
    noisy_pv = loop.pv + 0.05 * loop.pv.std() * np.random.default_rng(seed).standard_normal(
        loop.pv.size
    )
    again, inside = None, None
    if (advice := found.tuning) is not None:
        proposed = (advice["gain"], advice["integral_time_s"] / loop.period)
        new = FAMILIES[family].draw_loop(causes, seed, settings=proposed)
        error = float(np.std(new.sp - new.pv))
        inside = advice["predicted_error_std_low"] <= error <= advice["predicted_error_std_high"]
        if advice["predicted_error_std"] is not None:
            again = advice["predicted_error_std"] / error
    errors = []
    for pv in (loop.pv, noisy_pv):
        one = read(loop.op, pv, loop.sp, auto=loop.auto, period=loop.period)
        errors.append(
            max(
                abs(one.gain / loop.settings[0] - 1.0),
                abs(one.integral_time_s / loop.settings[1] - 1.0),
            )
            if one is not None and one.gain
            else float("nan")
        )
    return {
        "causes": causes,
        "seed": seed,
        "named": [cause.name.value for cause in found.causes],
        "period": found.oscillation.period_s / loop.cycle_s if found.oscillation.present else None,
        "clean": errors[0],
        "noisy": errors[1],
        "predicted": again,
        "inside": inside,
        "seconds": seconds,
    }


def judge_event(job: tuple[str, str, int], family: str) -> dict[str, Any]:
    """The place of the true source among the candidates of an event."""
    plant, source, seed = job
    event = FAMILIES[family].draw_event(plant, source, seed)
    found = {
        name: diagnose(one.op, one.pv, one.sp, auto=one.auto, period=one.period, advice=False)
        for name, one in event.loops.items()
    }
    signals = {
        name: LoopSignals(one.op, one.pv, one.sp, one.period) for name, one in event.loops.items()
    }
    groups = find_groups(signals, found)
    best = max(groups, key=lambda g: len(set(g.loops) & set(event.members)), default=None)
    place = None
    if best is not None and set(best.loops) & set(event.members):
        order = [one.loop for one in best.candidates]
        place = order.index(event.origin) + 1 if event.origin in order else 99
    return {
        "source": source,
        "plant": plant,
        "seed": seed,
        "loops": len(event.loops),
        "members": len(event.members),
        "place": place,
        "groups": len(groups),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables; write them with ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=60, help="loops of every cause")
    parser.add_argument("--events", type=int, default=15, help="events of every plant and source")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--part", type=Path, help="write the results of this run here, no tables")
    parser.add_argument(
        "--parts", type=Path, nargs="+", help="print one table of these runs, written with --part"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--family", choices=tuple(FAMILIES), default="report")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    if options.parts:
        documents = [json.loads(path.read_text()) for path in options.parts]
        loops = [one | {"causes": tuple(one["causes"])} for d in documents for one in d["loops"]]
        plant_wide = [one for d in documents for one in d["events"]]
    else:
        loops, plant_wide = judge_family(options)
    if options.part:
        options.part.write_text(json.dumps({"loops": loops, "events": plant_wide}))
        return
    seeds = sorted({one["seed"] for one in (*loops, *plant_wide)})
    parts = [
        heading(
            "diagnosis", __doc__, _as_one_run(loops, plant_wide) if options.parts else arguments
        ),
        f"Seeds {', '.join(map(str, seeds))}; {len(loops)} loops and {len(plant_wide)} "
        f"events of the {options.family} family.",
        "## Single loops: the first cause",
        confusion(loops),
        summary(loops),
        "## Pairs of causes",
        pairs(loops),
        "## Events of a plant: the place of the true source",
        "A source outside of all loops counts as first where that is the first candidate.",
        places(plant_wide),
        "## Recorded loops: oscillating or not",
        recorded(options.data),
    ]
    text = "\n\n".join(parts)
    print(text)
    keep(options.out, "diagnosis", text, {"loops": loops, "events": plant_wide})


def _as_one_run(loops: Sequence[dict[str, Any]], events: Sequence[dict[str, Any]]) -> list[str]:
    """The options that judge in one run what several parts have judged."""
    seeds = [[one["seed"] for one in rows] for rows in (loops, events)]
    first = min(min(one) for one in seeds if one)
    counts = [max(one, default=first - 1) - first + 1 for one in seeds]
    return ["--first", str(first), "--loops", str(counts[0]), "--events", str(counts[1])]


def judge_family(options: argparse.Namespace) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The loops and events of the seeds asked for, judged in worker processes."""
    kinds: list[tuple[str, ...]] = [*((cause,) for cause in CAUSES), *PAIRS]
    seeds = range(options.first, options.first + max(options.loops, options.events))
    jobs = [(kind, seed) for seed in seeds[: options.loops] for kind in kinds]
    plants = FAMILIES[options.family].PLANTS
    events = [(p, s, seed) for seed in seeds[: options.events] for p in plants for s in SOURCES]
    loop, event = (partial(judge, family=options.family) for judge in (judge_loop, judge_event))
    if options.workers == 1:
        return [loop(job) for job in jobs], [event(job) for job in events]
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(loop, jobs, chunksize=4)), list(pool.map(event, events))


def confusion(loops: Sequence[dict[str, Any]]) -> str:
    """Rows are true, columns what comes first."""
    columns = [*CAUSES, "undetermined"]
    rows = []
    for cause in CAUSES:
        mine = [one for one in loops if one["causes"] == (cause,)]
        tally = Counter(one["named"][0] for one in mine)
        decided = len(mine) - tally["undetermined"]
        right = tally[cause] / decided if decided else float("nan")
        rows.append([cause, *(tally[c] or "" for c in columns), f"{right:.0%}"])
    short = [c.replace("_", " ") for c in columns]
    return table(["true", *short, "right of decided"], rows)


def summary(loops: Sequence[dict[str, Any]]) -> str:
    """Figures over all loops."""
    single = [one for one in loops if len(one["causes"]) == 1]
    healthy = [one for one in loops if "sticky_valve" not in one["causes"]]
    false = sum("sticky_valve" in one["named"] for one in healthy)
    right = sum(one["named"][0] == one["causes"][0] for one in single)
    unsure = sum(one["named"][0] == "undetermined" for one in single)
    periods = [
        one["period"]
        for one in loops
        if "external_oscillation" in one["causes"] and one["period"] is not None
    ]
    near = float(np.mean(np.abs(np.array(periods) - 1.0) < 0.05)) if periods else float("nan")
    clean = np.array([one["clean"] for one in loops])
    noisy = np.array([one["noisy"] for one in loops])
    seconds = np.array([one["seconds"] for one in loops])
    rows = [
        ["right cause first, single loops", f"{right} of {len(single)}"],
        ["undetermined", f"{unsure} of {len(single)}"],
        ["sticky valve named without one", f"{false} of {len(healthy)}"],
        ["period of an outside wave within 5 %", f"{near:.0%} of {len(periods)}"],
        ["controller within 5 %, as recorded",
         f"{np.mean(clean[np.isfinite(clean)] < 0.05):.0%}, none read {np.isnan(clean).sum()}"],
        ["controller within 15 %, PV with 5 % noise more",
         f"{np.mean(noisy[np.isfinite(noisy)] < 0.15):.0%}, none read {np.isnan(noisy).sum()}"],
        ["error under proposed settings within 15 % of its prediction", _near(loops)],
        ["the same, loops without a sticky valve", _near(healthy)],
        ["the range that is told holds the error", _inside(loops)],
        ["proposals without a single figure: the range is too wide", _unsure(loops)],
        ["processor seconds a loop, median and 95 %",
         f"{np.nanmedian(seconds):.2f}, {np.nanquantile(seconds, 0.95):.2f}"],
    ]  # fmt: skip
    return table(["figure", "value"], rows)


def _near(loops: Sequence[dict[str, Any]]) -> str:
    found = np.array([one["predicted"] for one in loops if one["predicted"] is not None])
    if found.size == 0:
        return "no settings were proposed"
    low, high = np.quantile(found, [0.1, 0.9])
    return (
        f"{np.mean(np.abs(found - 1.0) < 0.15):.0%} of {found.size}; predicted over simulated, "
        f"10 and 90 %: {low:.2f}, {high:.2f}"
    )


def _inside(loops: Sequence[dict[str, Any]]) -> str:
    found = [one["inside"] for one in loops if one["inside"] is not None]
    return f"{sum(found)} of {len(found)} proposals"


def _unsure(loops: Sequence[dict[str, Any]]) -> str:
    found = [one["predicted"] is None for one in loops if one["inside"] is not None]
    return f"{sum(found)} of {len(found)}"


def pairs(loops: Sequence[dict[str, Any]]) -> str:
    """Count loops with two causes: those where one of them comes first, and both are named."""
    rows = []
    for kind in PAIRS:
        mine = [one for one in loops if one["causes"] == kind]
        if not mine:
            continue
        one_first = sum(one["named"][0] in kind for one in mine)
        both = sum(set(kind) <= set(one["named"]) for one in mine)
        rows.append([" and ".join(kind), len(mine), one_first, both])
    return table(["causes", "loops", "one of them first", "both named"], rows)


def places(events: Sequence[dict[str, Any]]) -> str:
    """Per source: events in which it is first, among the first three, later, or not found."""
    if not events:
        return "No event was drawn in this run (``--events 0``)."
    rows: list[list[Any]] = []
    for source in SOURCES:
        mine = [one for one in events if one["source"] == source]
        if source == "none":
            quiet = sum(one["groups"] == 0 for one in mine)
            rows.append(["none", len(mine), f"no group in {quiet}", "", "", ""])
            continue
        first = sum(one["place"] == 1 for one in mine)
        third = sum(one["place"] is not None and one["place"] <= 3 for one in mine)
        missed = sum(one["place"] is None for one in mine)
        later = len(mine) - third - missed
        rows.append([source, len(mine), first, third, later, missed])
    return table(["source", "events", "first", "first three", "later", "no group"], rows)


def recorded(data: Path) -> str:
    """The labelled recordings: how many labels agree, and those that do not."""
    labels = data / "oscillation_labels.csv"
    if not labels.is_file():
        return f"Skipped: {labels.name} is absent."
    rows, agree, count = [], 0, 0
    with labels.open() as stream:
        for row in csv.DictReader(stream):
            op = np.genfromtxt(data / "oscillation" / row["file"], skip_header=1)
            found = detect_oscillation(op, period=float(row["period_s"]))
            same = found.present == (row["oscillating"] == "1")
            count, agree = count + 1, agree + same
            if not same:
                rows.append([row["file"], row["oscillating"], int(found.present), found.period_s,
                             found.regularity, found.cycles, found.share])  # fmt: skip
    head = ["file", "label", "found", "period / s", "regularity", "periods", "share"]
    return f"{agree} of {count} labels agree. The others:\n\n{table(head, rows)}"


if __name__ == "__main__":
    main()
