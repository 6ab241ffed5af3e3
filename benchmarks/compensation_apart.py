"""Compensation on plants written apart: figures for reporting, of loops that nothing was tuned on.

``python -m benchmarks.compensation_apart`` runs `HybridMpc` under its `Supervisor` on the loops of
`benchmarks.apart`. Each row is a run: PV's root mean square error, IAE, the stem's travel and its
reversals, and the scans after which the loop was given back. Figures are over those before the
model was offered; those of a disturbed loop over the same loop's, with the same noise and
disturbance, when its own controller goes on, or its travel over what a ramping set-point asks of
the stem, one slip jump a turn included, if that is more. A row is good when PV and travel are at
most 0.5 and 1 times those. A set-point that no controller can reach is left out, with the 100 scans
after it. A scan is harmed when over the last 60 scans PV is above 1.1 times **and** travel above 2
times those (and those of the loop's own controller over the same 60 scans of the same disturbance),
or when the error is beyond three times its known range; the last column is the most of them in a
row, and a row counts as harmed from more than 60 on. ``--quick`` takes few rows, ``--first`` other
seeds.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.apart.loops import (
    DISTURBANCES,
    UNREACHED,
    WARM,
    WRONG,
    Course,
    Loop,
    asked_way,
    play,
)
from benchmarks.apart.plants import PROCESSES, VALVES
from benchmarks.report import heading, keep, machine, table

__all__ = ["Row", "judge", "list_rows", "main", "run"]

_FIRST = 150
_SETTLE = 60
_LONG = 60


@dataclass(frozen=True, slots=True)
class Row:
    """One run; ratios are over the same loop before the model was offered.

    Attributes:
        loop, parameters, disturbance, seed: of the run.
        pv, iae, travel, reversals: ratios.
        given_back: scans after the offer, NaN if the compensator kept the loop.
        harmed: most scans in a row that were harmed.
        reason: why the loop was given back.
        offered: whether there was a model to use.
    """

    loop: str
    parameters: str
    disturbance: str
    seed: int
    pv: float
    iae: float
    travel: float
    reversals: float
    given_back: float
    harmed: int
    reason: str
    offered: bool

    @property
    def good(self) -> bool:
        """Whether PV and travel are what compensation promises."""
        return self.pv <= 0.5 and self.travel <= 1.0


def judge(
    course: Course,
    own: Course | None = None,
    left_out: range = range(0),
    asked: np.ndarray | None = None,
) -> dict[str, float | int]:
    """Return the figures of a run over those of ``own`` after the offer, or its own before; the
    scans ``left_out`` count for neither. ``asked`` is the stem's way that the set-point asks for.
    """
    after = np.array([k for k in range(WARM + _SETTLE, course.error.size) if k not in left_out])
    base, before = (course, np.arange(_FIRST, WARM)) if own is None else (own, after)
    e, way = course.error, _ways(course)

    def reversals(of: Course, part: np.ndarray) -> float:
        steps = np.diff(of.stem)[part - 1]
        moved = steps[np.abs(steps) > 1e-9]
        return float(np.sum(moved[1:] * moved[:-1] < 0.0)) / max(1, steps.size)

    def ratio(new: float, old: float) -> float:
        return new / old if old > 0.0 else (0.0 if new == 0.0 else math.inf)

    known = base.error[before]
    rms = float(np.sqrt(np.mean(known**2)))
    travel = float(np.mean(_ways(base)[before]))
    allowed = travel if asked is None else max(travel, float(np.mean(asked[before])))
    largest = max(float(np.abs(known).max()), float(np.abs(e[_FIRST:WARM]).max()))
    lost = np.flatnonzero(course.compensating[WARM:-1] & ~course.compensating[WARM + 1 :])
    return {
        "pv": ratio(float(np.sqrt(np.mean(e[after] ** 2))), rms),
        "iae": ratio(float(np.mean(np.abs(e[after]))), float(np.mean(np.abs(known)))),
        "travel": ratio(float(np.mean(way[after])), allowed),
        "reversals": ratio(reversals(course, after), reversals(base, before)),
        "given_back": float(lost[-1]) + 1.0
        if lost.size and not course.compensating[-1]
        else math.nan,
        "harmed": _harmed(course, own, rms, travel, largest, left_out),
    }


def _ways(of: Course) -> np.ndarray:
    """Return how far the stem went in each scan."""
    return np.abs(np.diff(of.stem, prepend=of.stem[0]))


def _harmed(
    course: Course,
    own: Course | None,
    rms: float,
    travel: float,
    largest: float,
    left_out: range,
) -> int:
    """Return the most scans in a row in which a compensated loop was harmed."""
    window = _LONG
    ones = np.ones(window) / window

    def lately(signal: np.ndarray) -> np.ndarray:
        return np.convolve(signal, ones)[: signal.size]

    usual, usual_travel = np.full(course.error.size, rms**2), np.full(course.error.size, travel)
    if own is not None:  # it meets the same disturbance
        usual = np.maximum(usual, lately(own.error**2))
        usual_travel = np.maximum(usual_travel, lately(_ways(own)))
    far = np.abs(course.error) > 3.0 * largest
    bad = (lately(course.error**2) > 1.1**2 * usual) & (lately(_ways(course)) > 2.0 * usual_travel)
    longest = run = 0
    for k in range(WARM + window, course.error.size):
        counts = course.compensating[k] and k not in left_out
        run = run + 1 if counts and (bad[k] or far[k]) else 0
        longest = max(longest, run)
    return longest


def _plan(quick: bool) -> Iterator[tuple[Loop, str, str]]:
    """Return loop, parameters and disturbance of every row."""
    processes = list(PROCESSES)[: 2 if quick else None]
    valves = list(VALVES)[: 1 if quick else None]
    for process in processes:
        for number, valve in enumerate(valves):
            loop = Loop(process, valve, ("pi", "mpc")[number % 2], driven=number == 2)
            wrong = ("exact", "identified") if number else (*WRONG, "identified")
            for parameters in wrong:
                yield loop, parameters, "none"
        loop = Loop(process, "He", "pi")
        for disturbance in DISTURBANCES[1:]:
            if not quick or disturbance in ("load step", "manual"):
                yield loop, "exact", disturbance


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--out", type=Path, help="folder for the report")
    options = parser.parse_args(arguments)
    rows = [
        run(loop, parameters, disturbance, seed)
        for loop, parameters, disturbance in _plan(options.quick)
        for seed in range(options.first, options.first + options.seeds)
    ]
    text = heading("compensation_apart", __doc__, arguments) + "\n\n" + list_rows(rows)
    print(text)
    figures = {"machine": machine(), "rows": [asdict(row) for row in rows]}
    keep(options.out, "compensation_apart", text, figures)
    return 0


def run(loop: Loop, parameters: str, disturbance: str, seed: int) -> Row:
    """Return one row; a disturbed loop is compared with its own controller's run."""
    course = play(loop, parameters, disturbance, seed)
    own = None if disturbance == "none" else play(loop, "none", disturbance, seed)
    out_of_reach = range(UNREACHED.start, UNREACHED.stop + 100)
    left_out = out_of_reach if disturbance == "saturation" else range(0)
    found = judge(course, own, left_out, asked_way(loop, disturbance))
    return Row(
        f"{loop.process}, {loop.valve}, {loop.own}",
        parameters,
        disturbance,
        seed,
        reason="" if math.isnan(found["given_back"]) else course.reason,
        offered=course.offered,
        **found,  # type: ignore[arg-type]
    )


def list_rows(rows: Sequence[Row]) -> str:
    """Return the summary and a table of all rows."""
    cells = [
        (
            r.loop,
            r.parameters if r.offered else f"{r.parameters} (none used)",
            r.disturbance,
            f"{r.pv:.2f}",
            f"{r.iae:.2f}",
            f"{r.travel:.2f}",
            f"{r.reversals:.2f}",
            "" if math.isnan(r.given_back) else f"{r.given_back:.0f} {r.reason}",
            r.harmed or "",
        )
        for r in rows
    ]
    header = ("loop", "parameters", "disturbance", "PV", "IAE", "travel", "reversals")
    listed = table((*header, "given back after", "scans harmed"), cells)
    return f"{summary(rows)}\n\n{listed}"


def summary(rows: Sequence[Row]) -> str:
    """Return a table of how many rows are good, given back and harmed, by kind."""
    kinds = {
        "exact, nothing else": [
            r for r in rows if (r.parameters, r.disturbance) == ("exact", "none")
        ],
        "identified": [r for r in rows if r.parameters == "identified"],
        "wrong parameters": [r for r in rows if r.parameters not in ("exact", "identified")],
        "exact, disturbed": [r for r in rows if r.disturbance != "none"],
    }
    cells = []
    for kind, found in kinds.items():
        harmed = sum(r.harmed > _LONG for r in found)
        back = sum(not math.isnan(r.given_back) for r in found)
        unused = sum(not r.offered for r in found)
        cells.append((kind, len(found), sum(r.good for r in found), back, unused, harmed))
    return table(("rows", "number", "good", "given back", "no model used", "harmed"), cells)


if __name__ == "__main__":
    raise SystemExit(main())
