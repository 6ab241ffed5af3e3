"""Simulated loops that nothing was chosen by: verdicts, S, J and intervals, kind by kind.

    python -m benchmarks.report_family --loops 60 --kinds all --seed-base 1000 --jobs 2

The loops of `benchmarks.families.report` have valves, processes, controllers, loads and historians
of their own. Every kind has a line of its own, because a sum over kinds depends on how many of
each there are. Accused and missed count certain verdicts; an uncertain one is half an error; loops
whose record does not hold what any method needs are counted apart ("hopeless"). Errors of S and J
are medians in per cent of the true S, coverage is of 90 % intervals; both are among sticky loops
called sticky. Times are of the processor.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.families.report import KINDS
from benchmarks.family_answers import Answer, Counts, answers, count, loops_of
from benchmarks.report import heading, keep, machine, table

__all__ = ["main"]

_VERDICTS = (
    "kind", "healthy", "accused", "uncertain", "declined",
    "sticky", "missed", "uncertain", "declined", "hopeless", "declined", "errors",
)  # fmt: skip
_NUMBERS = (
    "kind", "called", "S error %", "J error %", "S covered %", "J covered %", "S width %",
    "mean ms", "p95 ms",
)  # fmt: skip


def _kinds(text: str) -> list[str]:
    names = list(KINDS) if text == "all" else [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name not in KINDS]
    if unknown:
        known = ", ".join(KINDS)
        raise argparse.ArgumentTypeError(f"no kind is called {unknown[0]}; choose from {known}")
    return names


def _verdicts(name: str, c: Counts) -> tuple[Any, ...]:
    healthy = (c.healthy, c.accused, c.healthy_uncertain, c.healthy_declined)
    sticky = (c.sticky, c.missed, c.sticky_uncertain, c.sticky_declined)
    shown = [
        *(healthy if c.healthy else ("",) * 4),
        *(sticky if c.sticky else ("",) * 4),
        *((c.hopeless, c.hopeless_declined) if c.hopeless else ("", "")),
    ]
    return (name, *shown, f"{c.errors:g}")


def _per_cent(value: float) -> str:
    return "" if value != value else f"{100 * value:.3g}"


def _numbers(name: str, c: Counts) -> tuple[Any, ...]:
    shares = (c.band_error, c.jump_error, c.band_coverage, c.jump_coverage, c.band_width)
    called = c.intervals if c.sticky else ""
    return (name, called, *map(_per_cent, shares), round(c.mean_ms), round(c.p95_ms))


def _by(found: Sequence[Answer], attribute: str) -> dict[str, Counts]:
    names = dict.fromkeys(str(getattr(a, attribute)) for a in found)
    return {name: count([a for a in found if getattr(a, attribute) == name]) for name in names}


def _reasons(found: Sequence[Answer]) -> list[tuple[Any, ...]]:
    """Why loops were declined: each reason with its healthy, sticky and hopeless loops."""
    declined = [a for a in found if a.is_declined]
    rows = []
    for code in dict.fromkeys(code for a in declined for code in a.reasons):
        named = [a for a in declined if code in a.reasons]
        fair = [a for a in named if a.is_assessable]
        sticky = sum(a.is_sticky for a in fair)
        rows.append((code, len(fair) - sticky, sticky, len(named) - len(fair)))
    return rows


def _wrong(found: Sequence[Answer]) -> str:
    """The seeds of every loop that was answered wrongly, to draw it again."""
    lines = []
    for sticky, word in ((False, "accused"), (True, "missed")):
        wrong = [a for a in found if a.is_assessable and a.is_sticky == sticky and a.error == 1.0]
        kinds = dict.fromkeys(a.kind for a in wrong)
        seeds = (f"{k} {' '.join(str(a.seed) for a in wrong if a.kind == k)}" for k in kinds)
        lines.append(f"- {word}: {'; '.join(seeds) or 'none'}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--loops", type=int, default=60, help="healthy and sticky, of each kind")
    parser.add_argument(
        "--kinds", type=_kinds, default="all", help="names separated by commas, or all"
    )
    parser.add_argument(
        "--seed-base", type=int, default=1000, help="seed of the first loop of each kind"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    parser.add_argument("--out", type=Path, help="folder for report_family.md and .json")
    options = parser.parse_args(arguments)
    found = answers(loops_of(options.kinds, options.loops, options.seed_base), options.jobs)
    by_kind, by_law, total = _by(found, "kind"), _by(found, "law"), count(found)
    last = options.seed_base + options.loops - 1
    laws = [_numbers(name, c) for name, c in by_law.items() if c.sticky]
    parts = [
        heading("report_family", __doc__, arguments),
        "## Verdicts",
        table(_VERDICTS, [*(_verdicts(k, c) for k, c in by_kind.items()), _verdicts("all", total)]),
        "## S, J, intervals and time",
        table(_NUMBERS, [*(_numbers(k, c) for k, c in by_kind.items()), _numbers("all", total)]),
        "## The same by the true valve's law",
        table(("law", *_NUMBERS[1:]), laws),
        "## Why declined",
        table(("reason", "healthy", "sticky", "hopeless"), _reasons(found)),
        f"## Seeds\n\nSeeds {options.seed_base} to {last} of every kind. Certain and wrong:",
        _wrong(found),
    ]
    print("\n\n".join(parts))
    figures = {
        "machine": machine(),
        "seeds": [options.seed_base, last],
        "total": asdict(total),
        "kinds": {name: asdict(c) for name, c in by_kind.items()},
        "laws": {name: asdict(c) for name, c in by_law.items()},
        "answers": [asdict(a) for a in found],
    }
    keep(options.out, "report_family", "\n\n".join(parts), figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
