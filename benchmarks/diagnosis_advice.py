"""Proposed settings: does the predicted range hold the error that they give?

Loops of the tuning family, those of `singles` and the wider ones of `advised`. The advice's
numbers were chosen on them, so the result is no proof. Each loop is simulated again under the
settings that are proposed for it. The report family's figures are those of
``benchmarks.diagnosis``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import PAIRS
from benchmarks.diagnosis_families.records import CAUSES, LoopRecord
from benchmarks.diagnosis_families.tuning import advised, singles
from benchmarks.report import heading, keep, table
from fieldlink.diagnosis import diagnose

NEAR = 0.15
"""Share of the error within which the single figure shall be."""


@dataclass(frozen=True)
class Judged:
    """Ends of the range and single figure, over the error that the settings then give."""

    low: float
    high: float
    single: float | None


def judge(draw: Callable[..., LoopRecord]) -> Judged | None:
    """The prediction for one loop beside the truth; None where nothing is proposed."""
    loop = draw()
    found = diagnose(loop.op, loop.pv, loop.sp, auto=loop.auto, period=loop.period).tuning
    if found is None:
        return None
    new = draw(settings=(found["gain"], found["integral_time_s"] / loop.period))
    error = float(np.std(new.sp - new.pv))
    single = found["predicted_error_std"]
    return Judged(
        found["predicted_error_std_low"] / error,
        found["predicted_error_std_high"] / error,
        None if single is None else single / error,
    )


def row(name: str, judged: Sequence[Judged | None]) -> list[str]:
    """One line of the table."""
    told = [one for one in judged if one is not None]
    inside = sum(one.low <= 1.0 <= one.high for one in told)
    single = [one.single for one in told if one.single is not None]
    near = sum(abs(one - 1.0) < NEAR for one in single)
    return [
        name,
        str(len(judged)),
        str(len(told)),
        f"{inside} of {len(told)}",
        f"{near} of {len(single)}",
        f"{np.median([one.high / one.low for one in told]):.2f}" if told else "",
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table; write it with ``--out``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=7000, help="first seed")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.seeds)
    kinds = [*((cause,) for cause in CAUSES), *PAIRS]

    def of_singles(causes: tuple[str, ...], seed: int) -> Judged | None:
        return judge(lambda **more: singles.draw_loop(causes, seed, **more))

    def of_advised(kind: str, seed: int) -> Judged | None:
        return judge(lambda **more: advised.draw_advised(kind, seed, **more))

    rows = [
        row("singles", [of_singles(causes, seed) for seed in seeds for causes in kinds]),
        row("advised", [of_advised(kind, seed) for seed in seeds for kind in advised.KINDS]),
    ]
    head = ["loops of", "loops", "proposals", "range holds", "single within 15 %", "median width"]
    text = "\n\n".join([heading("diagnosis_advice", __doc__, arguments), table(head, rows)])
    print(text)
    keep(options.out, "diagnosis_advice", text, {"rows": rows})


if __name__ == "__main__":
    main()
