"""Methods against stiction on the same loops: verdicts, S, J and what they cost.

    python -m benchmarks.methods --loops 8 --seed-base 1000 --jobs 2 [--out docs/benchmarks]

The loops are the report family's, each method gets the same samples. The published methods are
written from their papers (`benchmarks.published`); their thresholds are the papers'. The paper's
grid and optimisation get ARX(2,2) and the dead time that fits best; they size a valve and give no
verdict. Most published methods presuppose an oscillation: a second table has the loops whose OP
oscillates regularly. "undecided" counts as half an error. The area is that of the ROC curve of the
score each method has. Errors of S and J are medians in per cent of the true S over all sticky loops
that a method sizes; times are of one core, as the median ratio to ours on the same loop. The
optimisation runs on --nlp-loops sticky loops only.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.families.report import KINDS, draw
from benchmarks.family_answers import HALF, Loop, loops_of
from benchmarks.report import heading, keep, machine, table
from benchmarks.rivals import OURS, RIVALS, SLOW, run
from benchmarks.roc import auc
from estimator import warm_up
from estimator.monitoring.indices import oscillation

__all__ = ["main"]


@dataclass(frozen=True, slots=True)
class _Found:
    """One method on one loop; S and J are as a share of the true S, NaN on healthy loops."""

    method: str
    kind: str
    is_sticky: bool
    is_regular: bool
    """Whether OP oscillates regularly, which most published methods presuppose."""
    call: str
    score: float
    band_error: float
    jump_error: float
    seconds: float

    @property
    def error(self) -> float:
        if self.call == "undecided":
            return HALF
        return float((self.call == "stiction") != self.is_sticky)


def _judge(task: tuple[Loop, tuple[str, ...]]) -> list[_Found]:
    (kind, sticky, seed), methods = task
    loop = draw(kind, sticky, seed)
    if not loop.assessable:
        return []
    found = []
    regular = oscillation(loop.op).is_regular
    for name in methods:
        timed = run(name, loop)
        f, s = timed.finding, loop.stick_band or math.nan
        found.append(
            _Found(
                method=name,
                kind=kind,
                is_sticky=sticky,
                is_regular=regular,
                call=f.call,
                score=f.score,
                band_error=abs(f.stick_band - loop.stick_band) / s,
                jump_error=abs(f.slip_jump - loop.slip_jump) / s,
                seconds=timed.seconds,
            )
        )
    return found


def _tasks(loops: Sequence[Loop], nlp_loops: int) -> list[tuple[Loop, tuple[str, ...]]]:
    """Every loop with its methods: the slow ones on sticky loops of as many kinds as possible."""
    quick = tuple(name for name in RIVALS if name not in SLOW)
    by_seed = sorted((loop for loop in loops if loop[1]), key=lambda loop: loop[2])
    chosen = set(by_seed[:: max(1, len(by_seed) // max(nlp_loops, 1))][:nlp_loops])
    return [(loop, (*quick, *SLOW) if loop in chosen else quick) for loop in loops]


def _median(values: Iterable[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan


def _area(found: Sequence[_Found]) -> float:
    known = [f for f in found if not math.isnan(f.score)]
    sticky = [f.is_sticky for f in known]
    return auc([f.score for f in known], sticky) if 0 < sum(sticky) < len(sticky) else math.nan


def _ratios(rows: Sequence[Sequence[_Found]]) -> dict[str, float]:
    ratios: dict[str, list[float]] = {}
    for row in rows:
        ours = next((f.seconds for f in row if f.method == OURS), math.nan)
        for f in row:
            ratios.setdefault(f.method, []).append(f.seconds / ours)
    return {name: _median(values) for name, values in ratios.items()}


def _summary(found: Sequence[_Found], ratio: float) -> dict[str, float | int]:
    healthy = [f for f in found if not f.is_sticky]
    sticky = [f for f in found if f.is_sticky]
    gives = any(f.call for f in found)
    return {
        "healthy": len(healthy),
        "accused": sum(f.call == "stiction" for f in healthy) if gives else math.nan,
        "undecided_healthy": sum(f.call == "undecided" for f in healthy) if gives else math.nan,
        "sticky": len(sticky),
        "missed": sum(f.call == "no_stiction" for f in sticky) if gives else math.nan,
        "undecided_sticky": sum(f.call == "undecided" for f in sticky) if gives else math.nan,
        "errors": sum(f.error for f in found) if gives else math.nan,
        "area": _area(found),
        "sized": sum(not math.isnan(f.band_error) for f in sticky),
        "band_error_percent": 100.0 * _median(f.band_error for f in sticky),
        "jump_error_percent": 100.0 * _median(f.jump_error for f in sticky),
        "mean_ms": 1e3 * float(np.mean([f.seconds for f in found])),
        "times_ours": ratio,
    }


def _plain(value: float | int) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() and value < 1e6 else value


def _by_kind(found: Sequence[_Found], methods: Sequence[str]) -> list[tuple[Any, ...]]:
    rows = []
    for kind in dict.fromkeys(f.kind for f in found):
        cells: list[Any] = []
        for method in methods:
            errors = [f.error for f in found if f.kind == kind and f.method == method]
            cells.append(f"{100 * float(np.mean(errors)):.0f}" if errors else "")
        rows.append((kind, *cells))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--loops", type=int, default=8, help="healthy and sticky, of each kind")
    parser.add_argument("--seed-base", type=int, default=1000, help="seed of each kind's first")
    parser.add_argument("--nlp-loops", type=int, default=10, help="loops for the optimisation")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, help="folder for methods.md and methods.json")
    options = parser.parse_args(arguments)
    tasks = _tasks(loops_of(KINDS, options.loops, options.seed_base), options.nlp_loops)
    context = get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context, initializer=warm_up) as pool:
        rows = [row for row in pool.map(_judge, tasks, chunksize=2) if row]
    found, ratios = [f for row in rows for f in row], _ratios(rows)
    by_method = {name: [f for f in found if f.method == name] for name in RIVALS}
    summaries = {n: _summary(part, ratios[n]) for n, part in by_method.items() if part}
    regular = {n: [f for f in part if f.is_regular] for n, part in by_method.items()}
    of_regular = {n: _summary(part, ratios[n]) for n, part in regular.items() if part}
    judges = [name for name, part in by_method.items() if any(f.call for f in part)]
    header = (
        *("method", "healthy", "accused", "undecided", "sticky", "missed", "undecided", "errors"),
        *("area", "sized", "S error %", "J error %", "mean ms", "times ours"),
    )
    last = options.seed_base + options.loops - 1
    parts = [
        heading("methods", __doc__, arguments),
        table(header, [(n, *map(_plain, s.values())) for n, s in summaries.items()]),
        "## Loops whose OP oscillates regularly",
        table(header, [(n, *map(_plain, s.values())) for n, s in of_regular.items()]),
        "## Errors in per cent, kind by kind",
        table(("kind", *judges), _by_kind(found, judges)),
        f"Seeds {options.seed_base} to {last} of every kind, records that can tell only.",
    ]
    print("\n\n".join(parts))
    figures = {
        "machine": machine(),
        "methods": summaries,
        "of_regular": of_regular,
        "found": [asdict(f) for f in found],
    }
    keep(options.out, "methods", "\n\n".join(parts), figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
