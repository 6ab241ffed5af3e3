"""Healthy valves under a triangular load whose period wanders: how many are accused.

    python -m benchmarks.wandering_loads --first 3450 --loops 150 [--out docs/benchmarks]

What a neighbouring loop with a sticky valve does to this one. The load is a triangle or a saw-tooth
of 3.5 cycles and more; its cycles differ in length by 0 to 6 %, its height does not. It enters at
the valve, within the process, or where PV is measured. Processes are a lag, two lags or a level,
under PI control by SIMC, slower or faster; PV has white noise of 0.3 to 25 % of its swing. No
set-point is recorded. Seeds below 3450 were looked at while the estimator was made; the others were
not.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import heading, keep, table
from estimator import Verdict, identify

__all__ = ["ENTRIES", "WanderingLoad", "draw", "main"]

Array = NDArray[np.float64]

ENTRIES = ("at the valve", "within the process", "at PV")
"""Where the load enters."""
_STEPS = 10
"""Of process and load in a scan."""
_SETTLING = 400
"""Scans before the record."""
_MOST_AT_LIMIT = 0.02
"""Share of scans at a limit of OP from which a loop is left out."""


@dataclass(frozen=True, slots=True)
class WanderingLoad:
    """A record of a healthy valve: OP and PV ``(n,)``, where the load enters, and its cycles."""

    op: Array
    pv: Array
    entry: str
    cycles: float


def draw(seed: int) -> WanderingLoad | None:
    """The loop of that seed; None where OP reaches its limits."""
    rng = np.random.default_rng([77, seed])
    n = int(rng.integers(500, 1200))
    scans = n + _SETTLING
    form = str(rng.choice(["lag", "two lags", "level"], p=[0.4, 0.4, 0.2]))
    gain = float(np.exp(rng.uniform(-1.0, 1.0))) * float(rng.choice([-1.0, 1.0]))
    lag = float(np.exp(rng.uniform(np.log(3.0), np.log(40.0))))
    second = lag * float(rng.uniform(0.1, 0.6)) if form == "two lags" else 0.0
    dead_time = float(np.exp(rng.uniform(np.log(0.3), np.log(8.0))))
    wait = dead_time + 0.5 + 0.5 * second
    closed = float(rng.uniform(0.8, 3.0)) * wait
    slow = 4.0 * (closed + wait)
    level = form == "level"
    own = lag if level else lag + 0.5 * second
    control = own / (gain * (closed + wait)), slow if level else min(own, slow)
    period = float(np.exp(rng.uniform(np.log(4.0), np.log(25.0)))) * (closed + wait)
    period = float(np.clip(period, 10.0, n / 3.5))
    rise = float(rng.choice([0.5, rng.uniform(0.5, 0.95)]))
    spread = float(rng.choice([0.0, rng.uniform(0.0, 0.06)]))
    entry = int(rng.integers(len(ENTRIES)))
    size = float(np.exp(rng.uniform(np.log(2.0), np.log(12.0))))
    load = size * _triangle(rng, scans, period, rise, spread)
    noise = rng.standard_normal(scans)
    share = float(np.exp(rng.uniform(np.log(0.003), np.log(0.25))))
    process = gain, lag, second, float(max(1, int(dead_time * _STEPS)))

    def run(deviation: float) -> tuple[Array, Array]:
        op, pv = _run(load, deviation * noise, process, control, level, entry)
        return op[_SETTLING:], pv[_SETTLING:]

    op, pv = run(share * float(np.std(run(0.0)[1])))
    if float(np.mean((op <= 0.0) | (op >= 100.0))) > _MOST_AT_LIMIT:
        return None
    return WanderingLoad(op, pv, ENTRIES[entry], n / period)


def _triangle(
    rng: np.random.Generator, scans: int, period: float, rise: float, spread: float
) -> Array:
    """Rises for so large a share of each cycle, at every step, between -1 and 1."""
    begins = [-period * float(rng.uniform())]
    while begins[-1] < scans:
        begins.append(begins[-1] + period * (1.0 + spread * float(rng.standard_normal())))
    at = np.arange(scans * _STEPS) / _STEPS
    phase = np.interp(at, begins, np.arange(len(begins))) % 1.0
    return np.where(phase < rise, 2.0 * phase / rise - 1.0, 1.0 - 2.0 * (phase - rise) / (1 - rise))


def _run(
    load: Array,
    noise: Array,
    process: tuple[float, float, float, float],
    control: tuple[float, float],
    level: bool,
    entry: int,
) -> tuple[Array, Array]:
    """OP and PV ``(scans,)`` from rest at 50 %."""
    gain, lag, second, late = process
    n = noise.size
    waiting, drawn = [0.0] * int(late), load.tolist()
    first = math.exp(-1.0 / (_STEPS * lag))
    last = math.exp(-1.0 / (_STEPS * second)) if second > 0.0 else 0.0
    op, pv = np.empty(n), np.empty(n)
    u, x, y, before, place = 50.0, 0.0, 0.0, 0.0, 0
    for k in range(n):
        pv[k] = y + noise[k]
        if entry == 2:
            pv[k] += abs(gain) * drawn[k * _STEPS]
        error = -float(pv[k])
        u += control[0] * (error - before + error / control[1])
        before = error
        u = min(max(u, 0.0), 100.0)
        op[k] = u
        for s in range(_STEPS):
            d = drawn[k * _STEPS + s]
            at = place % len(waiting)
            flow = waiting[at]
            waiting[at] = u - 50.0 + (d if entry == 0 else 0.0)
            place += 1
            within = 0.5 * gain * d if entry == 1 else 0.0
            if level:
                x += (gain * flow + within) / (lag * _STEPS)
                y = x
            else:
                x = first * x + (1.0 - first) * gain * flow
                y = last * y + (1.0 - last) * (x + within)
    return op, pv


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge the loops, print and keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wandering_loads")
    parser.add_argument("--first", type=int, default=3450, help="first seed")
    parser.add_argument("--loops", type=int, default=150)
    parser.add_argument("--out", type=Path, metavar="FOLDER")
    chosen = parser.parse_args(arguments)
    called: dict[str, list[str]] = {entry: [] for entry in ENTRIES}
    accused = []
    for seed in range(chosen.first, chosen.first + chosen.loops):
        loop = draw(seed)
        if loop is None:
            continue
        found = identify(loop.op, loop.pv, period=1.0)
        call = "uncertain" if found.uncertain else found.verdict.value
        called[loop.entry].append(call)
        if call == Verdict.STICTION.value:
            accused.append({"seed": seed, "entry": loop.entry, "cycles": loop.cycles})
    header = ("load enters", "loops", "accused", "uncertain", "not assessable")
    calls = (Verdict.STICTION.value, "uncertain", Verdict.NOT_ASSESSABLE.value)
    counts = {entry: [len(all_), *map(all_.count, calls)] for entry, all_ in called.items()}
    counts["all"] = [sum(column) for column in zip(*counts.values(), strict=True)]
    rows = [(entry, *count) for entry, count in counts.items()]
    text = heading("wandering_loads", __doc__, arguments) + "\n\n" + table(header, rows)
    print(text)
    figures = [dict(zip(header, row, strict=True)) for row in rows]
    keep(chosen.out, "wandering_loads", text, {"rows": figures, "accused": accused})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
