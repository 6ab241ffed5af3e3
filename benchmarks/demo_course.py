"""The demonstration's course in virtual time: many noises, lost polls, late take-overs.

``python -m benchmarks.demo_course`` runs what ``fieldlink demo`` shows without waiting for a clock:
the unaware MPC on Example 1, one window of 600 samples, one block, the compensator. Each of
``--seeds`` noises runs with the operator's enable 20 and 45 scans after the window: the state that
the compensator takes over differs. ``--lost`` of the polls get no answer, as on a machine that has
other work. A run is good when PV's deviation is at most 0.35 times and the stem's travel at most
once that before, as `fieldlink.lab.demo.outcome` measures both. Many of these windows leave J open,
so that the block states an interval from near 0 to above twice the J written.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass, fields
from itertools import repeat
from pathlib import Path

import numpy as np
import structlog

from benchmarks.report import heading, keep, machine, table
from fieldlink.lab.demo.outcome import Change, phases
from fieldlink.lab.plc import Truth
from fieldlink.lab.rehearse import load_scenario, rehearse
from fieldlink.lab.rehearse.outcome import RunCourse

__all__ = ["Run", "main", "run"]

WINDOW, ENABLED_AFTER, AFTER = 600, (20, 45), 715
PV_LIMIT, TRAVEL_LIMIT = 0.35, 1.0
"""Those of the demonstration's test."""

SCENARIO = """
setpoint = [[0, 50], [10, 54], [300, 52]]
[scenario]
title = "The demonstration's course"
duration = {duration}
seed = {seed}
[plant]
fmu = "example1"
parameters = {{ op_start = 50.0 }}
[controller]
kind = "mpc"
compensate = true
[daemon]
window = {window}
write_back = true
estimate_every = {quarter}
[[network]]
kind = "drop"
share = {lost}
begin = 0
end = {duration}
[[maintenance]]
kind = "disable"
begin = 0
end = {enabled}
[[expect]]
kind = "verdict"
verdict = "stiction"
"""


@dataclass(frozen=True, slots=True)
class Run:
    """One run.

    Attributes:
        seed: of noise and lost polls.
        enabled: scans after the window from which the operator allows blocks.
        stick_band, slip_jump: identified; NaN where the first window has none.
        low, high: interval of J.
        pv, travel: after over before; NaN where no compensator took over.
        given_back: whether the compensator gave the loop back.
    """

    seed: int
    enabled: int
    stick_band: float
    slip_jump: float
    low: float
    high: float
    pv: float
    travel: float
    given_back: bool

    @property
    def good(self) -> bool:
        """Whether both ratios are within the demonstration's limits."""
        return self.pv <= PV_LIMIT and self.travel <= TRAVEL_LIMIT


def run(seed: int, enabled: int, lost: float) -> Run:
    """Run one course."""
    text = SCENARIO.format(
        duration=WINDOW + AFTER,
        seed=seed,
        window=WINDOW,
        quarter=WINDOW // 4,
        lost=lost,
        enabled=WINDOW + enabled,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.toml"
        path.write_text(text)
        course = rehearse(load_scenario(path)).course
    first = course.windows[0]
    pv, travel = _changes(course)
    taken = np.flatnonzero(course.trend.compensated)
    return Run(
        seed,
        enabled,
        first.stick_band.value,
        first.slip_jump.value,
        first.slip_jump.low,
        first.slip_jump.high,
        pv,
        travel,
        taken.size > 0 and not course.trend.compensated[taken[0] :].all(),
    )


def _changes(course: RunCourse) -> tuple[float, float]:
    """Return PV's deviation and the stem's travel, after over before."""
    trend = course.trend
    truth = Truth(
        np.arange(trend.time.size),
        trend.op,
        trend.pv,
        trend.sp,
        trend.stem,
        trend.automatic,
        trend.compensated,
    )
    before, after = phases(truth)
    if after is None:
        return np.nan, np.nan
    return (
        Change(before.pv_std, after.pv_std).ratio,
        Change(before.valve_travel, after.valve_travel).ratio,
    )


def _quiet() -> None:
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(50))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print the counts and the runs that are not good."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--lost", type=float, default=0.03, help="share of the polls")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--out", type=Path, help="folder for the page")
    options = parser.parse_args(arguments)
    jobs = [
        (seed, enabled)
        for seed in range(options.first, options.first + options.seeds)
        for enabled in ENABLED_AFTER
    ]
    with ProcessPoolExecutor(options.workers, initializer=_quiet) as pool:
        runs = list(pool.map(run, *zip(*jobs, strict=True), repeat(options.lost)))
    counts = (
        ("runs", len(runs)),
        ("good", sum(r.good for r in runs)),
        ("no compensator took over", sum(bool(np.isnan(r.pv)) for r in runs)),
        ("given back", sum(r.given_back for r in runs)),
        ("more travel than before", sum(r.travel > TRAVEL_LIMIT for r in runs)),
        ("more than twice the travel of before", sum(r.travel > 2.0 for r in runs)),
    )
    text = heading("demo_course", __doc__, arguments)
    text += "\n\n" + table(("what", "number"), counts)
    worse = [astuple(r) for r in runs if not r.good]
    if worse:
        text += "\n\nThe runs that are not good (S is 11, J is 3):\n\n"
        text += table([f.name.replace("_", " ") for f in fields(Run)], worse)
    print(text)
    figures = {"machine": machine(), "counts": dict(counts), "runs": [astuple(r) for r in runs]}
    keep(options.out, "demo_course", text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
