"""Monte Carlo over loops of many kinds: bias and spread of S, coverage, false alarms, misses.

    python -m benchmarks.robustness [--runs 200] [--seed 0] [--out docs/benchmarks]

Half as many healthy loops as sticky ones are judged. A sticky valve that the window does not show
(the estimator says so, with a reason) counts as not assessable, never as a miss. Choudhury's valve
counts its band anew at every turn of OP, so under a noisy OP it really sticks for much more than
its S: its rows show how far apart the published models are, not an error of the estimate.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.loops import Loop, draw_loop, record
from benchmarks.report import keep, machine, table
from estimator import identify, warm_up

__all__ = ["Judgement", "group", "judge", "main"]


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the estimator said about a loop; ``turns`` as in `benchmarks.loops.Recording`."""

    loop: Loop
    verdict: str
    reasons: tuple[str, ...]
    score: float
    stick_band: tuple[float, float, float]
    slip_jump: tuple[float, float, float]
    turns: int
    seconds: float


def judge(loop: Loop, *, samples: int = 1000) -> Judgement:
    """Record a loop and let the estimator judge it."""
    trace = record(loop, samples=samples)
    begun = time.perf_counter()
    result = identify(trace.op, trace.pv, sp=trace.sp)
    seconds = time.perf_counter() - begun
    s, j = result.stick_band, result.slip_jump
    return Judgement(
        loop=loop,
        verdict=result.verdict.value,
        reasons=tuple(reason.code.value for reason in result.reasons),
        score=result.score,
        stick_band=(s.value, s.low, s.high),
        slip_jump=(j.value, j.low, j.high),
        turns=trace.turns,
        seconds=seconds,
    )


def _share(judged: Sequence[Judgement], verdict: str) -> float:
    return sum(one.verdict == verdict for one in judged) / len(judged) if judged else float("nan")


def group(name: str, judged: Sequence[Judgement]) -> list[Any]:
    """One row: verdicts of all, errors and coverage of those with the verdict stiction."""
    row: list[Any] = [name, len(judged)]
    row += [_share(judged, v) for v in ("stiction", "no_stiction", "not_assessable")]
    found = [one for one in judged if one.verdict == "stiction" and not one.loop.is_healthy]
    if not found:
        return [*row, *[float("nan")] * 6]
    error = np.array([one.stick_band[0] / one.loop.stick_band - 1.0 for one in found])
    jump = np.array([one.slip_jump[0] - one.loop.slip_jump for one in found])
    size = np.array([one.loop.stick_band for one in found])
    row += [float(np.median(error)), float(np.subtract(*np.quantile(error, [0.75, 0.25])))]
    row += [float(np.median(np.abs(error))), float(np.median(np.abs(jump) / size))]
    for truth, bands in (
        ([one.loop.stick_band for one in found], [one.stick_band for one in found]),
        ([one.loop.slip_jump for one in found], [one.slip_jump for one in found]),
    ):
        inside = [low <= t <= high for t, (_, low, high) in zip(truth, bands, strict=True)]
        row.append(sum(inside) / len(inside))
    return row


_HEADER = (
    "loops", "n", "stiction", "no stiction", "not assessable", "bias S", "IQR S", "|error| S",
    "|error| J / S", "cover S", "cover J",
)  # fmt: skip


def _rows(judged: Sequence[Judgement]) -> list[list[Any]]:
    every = [one for one in judged if not one.loop.is_healthy]
    sticky = [one for one in every if one.turns >= 4]
    healthy = [one for one in judged if one.loop.is_healthy]
    fair = [one for one in sticky if one.loop.is_moderate and one.loop.stick_band >= 2.0]
    rows = [
        group("all sticky", every),
        group("cycle not in the window", [one for one in every if one.turns < 4]),
        group("cycle in the window", sticky),
        group("of these, S >= 2 %, moderate noise", fair),
    ]
    ways: list[tuple[str, Callable[[Loop], str]]] = [
        ("physics", lambda loop: loop.physics),
        ("process", lambda loop: loop.process),
        ("controller", lambda loop: loop.controller),
        ("noise", lambda loop: loop.noise_kind),
        ("S", lambda loop: "0.5-2 %" if loop.stick_band < 2.0 else "2-10 %"),
        ("sampling", lambda loop: "0.05-0.2 T" if loop.sampling < 0.2 else "0.2-1 T"),
    ]
    for name, key in ways:
        for value in sorted({key(one.loop) for one in sticky}):
            rows.append(group(f"{name}: {value}", [o for o in sticky if key(o.loop) == value]))
    rows.append(group("all healthy", healthy))
    for value in sorted({one.loop.trouble for one in healthy}):
        chosen = [one for one in healthy if one.loop.trouble == value]
        rows.append(group(f"healthy, trouble: {value}", chosen))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="sticky loops; half as many healthy")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="folder for robustness.md and robustness.json")
    options = parser.parse_args(arguments)
    warm_up()
    seeds = range(options.seed, options.seed + options.runs)
    loops = [draw_loop(seed, healthy=False) for seed in seeds]
    loops += [draw_loop(seed, healthy=True) for seed in seeds[: max(1, options.runs // 2)]]
    judged = [judge(loop, samples=options.samples) for loop in loops]
    rows = _rows(judged)
    text = table(_HEADER, rows)
    print(text)
    figures = {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "table": [dict(zip(_HEADER, row, strict=True)) for row in rows],
        "loops": [asdict(one) for one in judged],
    }
    keep(options.out, "robustness", text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
