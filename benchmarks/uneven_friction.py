"""Sticky valves whose friction is another one at every slip: how many are found.

    python -m benchmarks.uneven_friction --first 1000 --loops 150 [--out docs/benchmarks]

The other side of `benchmarks.wandering_loads`: what clears a healthy valve under an uneven wave
must not clear these. Static and dynamic friction are drawn anew for every slip, together or each by
itself, with a deviation of 2 to 20 % of their mean. A stem sticks again at once, or follows OP
until OP turns. S is 2 to 8 % and J 10 to 90 % of it; processes are a lag of 2 to 25 scans and a
dead time of none to five, under PI control by SIMC, slower or faster; PV has white noise of 0.25 to
10 % of what a slip makes. Every second OP is recorded in steps of 0.1 %. No set-point is recorded.
Loops with fewer than six strokes are left out. Seeds below 1000 were looked at while the estimator
was made; the others were not.
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
from estimator import Identification, Verdict, identify

__all__ = ["SPREADS", "UnevenLoop", "draw", "main"]

Array = NDArray[np.float64]

SPREADS = ((0.02, 0.08), (0.08, 0.2))
"""Deviations of the frictions over their means: small and large ones."""
_SETTLING = 300
"""Scans before the record."""
_FEWEST_STROKES = 6
_REST = 50.0
"""OP and stem at first."""


@dataclass(frozen=True, slots=True)
class UnevenLoop:
    """A record of a sticky valve: OP, PV and the stem ``(n,)``, S, and how the friction varies."""

    op: Array
    pv: Array
    stem: Array
    stick_band: float
    spread: float
    slides: bool


class _Valve:
    """A stem whose static and dynamic friction are drawn for each slip."""

    def __init__(
        self, rng: np.random.Generator, band: float, jump: float, spread: float, slides: bool
    ) -> None:
        self._rng, self._slides, self._spread = rng, slides, spread
        self._means = 0.5 * (band + jump), 0.5 * (band - jump)
        self._together = bool(rng.integers(2))
        self.stem, self._way, self._before = _REST, 0.0, _REST
        self._draw()

    def move(self, op: float) -> float:
        """The stem after OP's next value."""
        change, self._before = op - self._before, op
        if self._way * change > 0.0:
            self.stem = op - self._way * self._dynamic
            return self.stem
        if self._way != 0.0:
            self._way = 0.0
            self._draw()
        if abs(op - self.stem) > self._static:
            way = math.copysign(1.0, op - self.stem)
            self.stem = op - way * self._dynamic
            if self._slides:
                self._way = way
            else:
                self._draw()
        return self.stem

    def _draw(self) -> None:
        first, second = self._rng.standard_normal(2)
        static, dynamic = self._means
        self._static = max(static * (1.0 + self._spread * first), 0.05 * static)
        second = first if self._together else second
        self._dynamic = min(dynamic * (1.0 + self._spread * second), 0.98 * self._static)


def draw(seed: int) -> UnevenLoop | None:
    """The loop of that seed; None where its valve makes too few strokes."""
    rng = np.random.default_rng([83, seed])
    n = int(rng.integers(500, 1500))
    lag, dead_time = float(np.exp(rng.uniform(np.log(2.0), np.log(25.0)))), int(rng.integers(6))
    wait = dead_time + 1.0
    closed = wait * float(rng.uniform(1.0, 3.0))
    gain, reset = lag / (closed + wait), min(lag, 4.0 * (closed + wait))
    band = float(rng.uniform(2.0, 8.0))
    jump = band * float(rng.uniform(0.1, 0.9))
    spread = float(rng.uniform(*SPREADS[int(rng.integers(2))]))
    slides = bool(rng.integers(2))
    noise = 0.5 * jump * float(np.exp(rng.uniform(np.log(0.005), np.log(0.2))))
    valve = _Valve(rng, band, jump, spread, slides)
    pole, waiting = math.exp(-1.0 / lag), [0.0] * (dead_time + 1)
    op, pv, stem = np.empty((3, n + _SETTLING))
    # no stem that rests meets the set-point to a hair: the loop swings about it
    aim = float(rng.uniform(0.6, 1.4))
    u, y, before = _REST, 0.0, 0.0
    for k in range(op.size):
        pv[k] = y + noise * rng.standard_normal()
        error = aim - float(pv[k])
        u = min(max(u + gain * (error - before + error / reset), 0.0), 100.0)
        before = error
        op[k], stem[k] = u, valve.move(u)
        waiting.append(stem[k] - _REST)
        y = pole * y + (1.0 - pole) * waiting.pop(0)
    op, pv, stem = op[_SETTLING:], pv[_SETTLING:], stem[_SETTLING:]
    ways = np.sign(np.diff(stem))
    ways = ways[ways != 0.0]
    if 1 + np.count_nonzero(np.diff(ways)) < _FEWEST_STROKES or not ways.size:
        return None
    if rng.integers(2):
        op = np.round(op, 1)
    return UnevenLoop(op, pv, stem, band, spread, slides)


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge the loops, print and keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.uneven_friction")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--loops", type=int, default=150)
    parser.add_argument("--out", type=Path, metavar="FOLDER")
    chosen = parser.parse_args(arguments)
    found = []
    for seed in range(chosen.first, chosen.first + chosen.loops):
        loop = draw(seed)
        if loop is not None:
            found.append((loop, identify(loop.op, loop.pv, period=1.0)))
    names = [
        (f"{'slides' if slides else 'sticks'}, {low:.0%} to {high:.0%}", slides, low, high)
        for slides in (False, True)
        for low, high in SPREADS
    ]
    header = ("stem, deviation", "loops", "found", "uncertain", "called healthy", "not assessable",
              "S, median error", "S in its 90 % interval")  # fmt: skip
    groups = {
        name: [one for one in found if one[0].slides is slides and low <= one[0].spread < high]
        for name, slides, low, high in names
    }
    rows = [(name, *_counts(group)) for name, group in [*groups.items(), ("all", found)]]
    text = heading("uneven_friction", __doc__, arguments) + "\n\n" + table(header, rows)
    print(text)
    figures = [dict(zip(header, row, strict=True)) for row in rows]
    keep(chosen.out, "uneven_friction", text, {"rows": figures})
    return 0


def _counts(group: Sequence[tuple[UnevenLoop, Identification]]) -> tuple[int | str, ...]:
    """Numbers of loops and of answers of each kind; error and coverage of S of those found."""
    calls = ["uncertain" if one.uncertain else one.verdict.value for _, one in group]
    bands = [
        (loop.stick_band, one.stick_band)
        for (loop, one), call in zip(group, calls, strict=True)
        if call == Verdict.STICTION.value
    ]
    errors = [abs(band.value / true - 1.0) for true, band in bands]
    held = [band.low <= true <= band.high for true, band in bands]
    names = Verdict.STICTION.value, "uncertain", Verdict.NO_STICTION.value
    return (
        len(group),
        *map(calls.count, (*names, Verdict.NOT_ASSESSABLE.value)),
        f"{np.median(errors):.1%}" if errors else "-",
        f"{np.mean(held):.0%}" if held else "-",
    )


if __name__ == "__main__":
    raise SystemExit(main())
