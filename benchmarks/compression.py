"""What a historian leaves: how long each method finds the sticky valve in a compressed record.

    python -m benchmarks.compression --loops 20 --seed-base 5000 --jobs 2 [--out docs/benchmarks]

Loops of the report family, sticky and healthy, are stored once as polled and then with rising dead
bands and falling sampling rates. *Door* is swinging-door compression read back by straight lines,
*held* the last value until an exception, both with a dead band as a share of each signal's
deviation; *sampled* keeps so many samples a stroke of the stem. A cell is the share of sticky loops
called sticky / of healthy loops called sticky, in per cent; "declined" is ours on the sticky ones.
An uncertain answer finds and accuses nothing. "kept" is the median number of own values of
PV in a stroke.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.loop import RecordedLoop
from benchmarks.families.report import draw
from benchmarks.families.report.records import hold_by_exception, store_swinging_door
from benchmarks.family_answers import Loop, loops_of
from benchmarks.report import heading, keep, machine, table
from benchmarks.rivals import OURS, RIVALS, SIZERS, run
from estimator import warm_up

__all__ = ["STORES", "main", "store"]

Array = NDArray[np.float64]

KINDS = ("pi", "sine", "load-steps", "integrating")
"""Kinds that a historian stores without a defect of their own."""

BANDS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Dead bands, share of a signal's deviation; historians' defaults are 0.5 to 2 % of the span."""
PER_STROKE = (16, 8, 4, 2)
"""Samples kept of a stroke."""
LONGEST = 200
"""Samples after which a historian stores a value in any case."""

Store = tuple[str, float]
"""How a record is kept, and its dead band or samples a stroke."""

STORES: tuple[Store, ...] = (
    ("polled", 0.0),
    *(("door", band) for band in BANDS),
    *(("held", band) for band in BANDS),
    *(("sampled", float(number)) for number in PER_STROKE),
)
"""What is compared."""

JUDGES = tuple(name for name in RIVALS if name not in SIZERS)
"""Methods that give a verdict."""


@dataclass(frozen=True, slots=True)
class _Found:
    store: Store
    kind: str
    seed: int
    is_sticky: bool
    kept: float
    calls: dict[str, str]
    band_error: float


def store(loop: RecordedLoop, how: Store) -> tuple[RecordedLoop, float]:
    """``loop`` as ``how`` keeps it, and the own values of PV that a stroke has left."""
    name, amount = how
    per_stroke = loop.pv.size / loop.strokes
    if name == "polled":
        return loop, per_stroke
    if name == "sampled":
        step = max(1, round(per_stroke / amount))
        sp = None if loop.sp is None else loop.sp[::step]
        thin = replace(
            loop, op=loop.op[::step], pv=loop.pv[::step], sp=sp, period=loop.period * step
        )
        return thin, per_stroke / step
    compress = store_swinging_door if name == "door" else hold_by_exception
    pv, kept = compress(loop.pv, amount * float(loop.pv.std()), LONGEST)
    op, _ = compress(loop.op, amount * float(loop.op.std()), LONGEST)
    return replace(loop, op=op, pv=pv), per_stroke * float(kept.mean())


def _judge(drawn: Loop) -> list[_Found]:
    kind, sticky, seed = drawn
    loop = draw(kind, sticky, seed)
    if not loop.assessable:
        return []
    found = []
    for how in STORES:
        kept_loop, kept = store(loop, how)
        findings = {name: run(name, kept_loop).finding for name in JUDGES}
        error = (
            abs(findings[OURS].stick_band - loop.stick_band) / loop.stick_band
            if sticky and findings[OURS].call == "stiction"
            else float("nan")
        )
        calls = {name: finding.call for name, finding in findings.items()}
        found.append(_Found(how, kind, seed, sticky, kept, calls, error))
    return found


def _per_cent(flags: Sequence[bool]) -> str:
    return f"{100 * float(np.mean(flags)):.0f}" if flags else "-"


def _row(how: Store, found: Sequence[_Found]) -> tuple[Any, ...]:
    part = [f for f in found if f.store == how]
    sticky = [f for f in part if f.is_sticky]
    healthy = [f for f in part if not f.is_sticky]
    cells = [
        f"{_per_cent([f.calls[name] == 'stiction' for f in sticky])} / "
        f"{_per_cent([f.calls[name] == 'stiction' for f in healthy])}"
        for name in JUDGES
    ]
    errors = [f.band_error for f in sticky if not np.isnan(f.band_error)]
    error = f"{100 * float(np.median(errors)):.0f}" if errors else ""
    declined = _per_cent([f.calls[OURS] == "undecided" for f in sticky])
    kept = f"{float(np.median([f.kept for f in part])):.1f}"
    level = "" if how[0] == "polled" else f"{how[1]:g}"
    return (how[0], level, kept, cells[0], declined, error, *cells[1:])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--loops", type=int, default=20, help="loops of each kind, healthy and sticky ones"
    )
    parser.add_argument(
        "--seed-base", type=int, default=5000, help="seed of the first loop of each kind"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    parser.add_argument("--out", type=Path, help="folder for compression.md and compression.json")
    options = parser.parse_args(arguments)
    loops = loops_of(KINDS, options.loops, options.seed_base)
    context = get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context, initializer=warm_up) as pool:
        found = [f for part in pool.map(_judge, loops) for f in part]
    polled = [f for f in found if f.store == STORES[0]]
    sticky = sum(f.is_sticky for f in polled)
    header = ("stored", "level", "kept", OURS, "declined", "S error %", *JUDGES[1:])
    text = "\n\n".join(
        [
            heading("compression", __doc__, arguments),
            table(header, [_row(how, found) for how in STORES]),
            f"{sticky} sticky and {len(polled) - sticky} healthy loops of {', '.join(KINDS)}.",
        ]
    )
    print(text)
    keep(
        options.out,
        "compression",
        text,
        {"machine": machine(), "found": [asdict(f) for f in found]},
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
