"""A year of a loop, one window a week: the valve wears, is repaired in week 40, and wears again.

    python examples/year_of_a_loop.py [--weeks 52] [--plot year.png]

Every week is simulated, identified, and the windows are followed by `estimator.track`, which finds
the repair and says when S would have reached a limit.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from compensator import UnawareMpc
from estimator import Identification, Track, Verdict, identify, track
from fieldlink.lab.study.closed_loop import EXAMPLE_2, Study, run
from loop_model import ValveModel

WEEK = 7 * 86400.0
LIMIT = 12.0
"""Stick band, in % of OP, that maintenance should not let pass."""


def week(stick_band: float, seed: int) -> Identification:
    """Simulate a window of the paper's Example 2 with this stick band, and identify it."""
    process = EXAMPLE_2.process
    study = Study([(0, 50.0), (60, 53.0), (350, 48.0)], 600, equation_noise=0.03, seed=seed)
    valve = ValveModel(stick_band, 0.4 * stick_band)
    trace = run(process, valve, UnawareMpc(process), study)
    return identify(trace.op, trace.pv, sp=trace.sp, period=process.period)


def main(arguments: Sequence[str] | None = None) -> Track:
    """Print the course of S; return the track."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--weeks", type=int, default=52, help="windows, one a week")
    parser.add_argument("--plot", type=Path, help="picture of the course")
    options = parser.parse_args(arguments)

    repaired = round(options.weeks * 0.75)
    ages = np.arange(options.weeks) - np.where(np.arange(options.weeks) < repaired, 0, repaired)
    truth = 4.0 + 6.0 * ages / max(repaired, 1)
    times, bands, jumps = [], [], []
    for number, stick_band in enumerate(truth):
        found = week(float(stick_band), seed=number)
        times.append(number * WEEK)
        bands.append(found.stick_band)
        jumps.append(found.slip_jump)
        mark = "" if found.verdict is Verdict.STICTION else f"  ({found.verdict.value})"
        print(f"week {number:2}: S {found.stick_band.value:5.2f}, true {stick_band:5.2f}{mark}")

    course = track(times, bands, jumps, stick_band_limit=LIMIT)
    for change in course.stick_band.changes:
        print(f"{change.kind.value} of S found, from week {change.onset} on")
    if options.plot is not None:
        draw(course, truth, options.plot)
    return course


def draw(course: Track, truth: np.ndarray, path: Path) -> None:
    """Draw the smoothed stick band over the true one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.asarray(course.stick_band.times) / WEEK, course.stick_band.value, label="tracked")
    axes.plot(truth, "k--", lw=0.8, label="true")
    axes.axhline(LIMIT, color="red", lw=0.8, label="limit")
    axes.set(xlabel="week", ylabel="stick band S, % of OP")
    axes.legend()
    figure.savefig(path)


if __name__ == "__main__":
    main()
