"""The paper again: Figures 2 and 3, and the row of loop CHEM 10 in its Table 1.

    python examples/paper.py [--out build] [--data ../shared/data]

Figure 2 is Example 1 in its limit cycle, with the estimated stem. Figure 3 is Example 2 under two
set-point steps: the MPC that knows nothing of the valve, and the compensator with the identified
valve. CHEM 10 is a recorded loop of the International Stiction Data Base, read from
DATA/isdb/CHEM10.csv; without the file the row is left out, and a line says so.

Source: Bacci di Capaci, Vaccari, Pannocchia and Scali, "Identification and estimation of valve
stiction by the use of a smoothed model" (2018).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from compensator import UnawareMpc
from estimator import Identification, identify
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2, Plant, Study, Trace, drive, run
from fieldlink.lab.study.controllers import Setup, staged

PUBLISHED = {"Table 1, proposed, tau 250": 0.22, "Table 1, grid": 1.70, "Lee et al.": 1.79}
"""Stick bands of CHEM 10 that the paper prints, in % of OP."""
TAKE_OVER = 1000
"""Sample at which the compensator gets the loop of Figure 3; the window before it is identified."""
SETTLED = (slice(TAKE_OVER + 210, TAKE_OVER + 460), slice(TAKE_OVER + 610, TAKE_OVER + 860))
"""Samples of Figure 3 that are judged: from 150 after each set-point step on."""


def figure_2(folder: Path) -> Identification:
    """Draw Example 1 at constant set-point; return what was identified."""
    process = EXAMPLE_1.process
    study = Study([(0, 50.0), (50, 54.0)], 900, equation_noise=0.01, seed=1)
    trace = run(process, EXAMPLE_1.valve, UnawareMpc(process), study)
    window = slice(200, 900)
    found = identify(trace.op[window], trace.pv[window], sp=trace.sp[window])
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    upper.plot(trace.pv[window], label="PV")
    upper.plot(found.pv_model, "--", label="PV, estimated")
    lower.plot(trace.op[window], label="OP")
    lower.plot(trace.stem[window], label="stem")
    lower.plot(found.stem, "--", label="stem, estimated")
    lower.set_xlabel("sample")
    for axes in (upper, lower):
        axes.legend(loc="upper right")
    figure.savefig(folder / "figure2.png")
    return found


def figure_3(folder: Path) -> dict[str, Trace]:
    """Draw Example 2 under two set-point steps with both controllers; return the signals."""
    process = EXAMPLE_2.process
    noise = 10.0**-1.5
    # As in the paper, the window that is identified holds set-point changes.
    before = [(0, 50.0), (40, 55.0), (350, 48.0), (700, 53.0)]
    steps = [*before, (TAKE_OVER + 60, 60.0), (TAKE_OVER + 460, 53.0)]
    study = Study(steps, TAKE_OVER + 860, equation_noise=noise, seed=1)
    plain = run(process, EXAMPLE_2.valve, UnawareMpc(process), study)
    window = slice(80, TAKE_OVER)
    found = identify(plain.op[window], plain.pv[window], sp=plain.sp[window])
    model = found.model or EXAMPLE_2
    aware = staged("hybrid", Setup(process, model), TAKE_OVER).controller
    plant = Plant(process, EXAMPLE_2.valve, study.op0)
    traces = {"unaware MPC": plain, "with the identified valve": drive(plant, aware, study)}
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, (title, trace) in enumerate(traces.items()):
        grid[0, column].set_title(title)
        grid[0, column].plot(trace.pv)
        grid[0, column].plot(trace.sp, "k--", lw=0.8)
        grid[1, column].plot(trace.op, label="OP")
        grid[1, column].plot(trace.stem, label="stem")
    grid[1, 0].legend()
    figure.savefig(folder / "figure3.png")
    return traces


def chem_10(data: Path) -> Identification | None:
    """Print the row of CHEM 10; None where the recording is not there."""
    file = data / "isdb" / "CHEM10.csv"
    if not file.is_file():
        print(f"CHEM 10: {file} is not there; name its folder with --data")
        return None
    loop = pd.read_csv(file)
    found = identify(loop["op"], loop["pv"])
    print(f"CHEM 10: {found.verdict.value}")
    rows = {"fieldlink": found.stick_band.value, **PUBLISHED}
    for name, stick_band in rows.items():
        print(f"  {name:28} S {stick_band:.2f}")
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw both figures and print the row."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("build"), help="folder for the pictures")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="recordings")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    found = figure_2(options.out)
    band, jump = found.stick_band, found.slip_jump
    print(f"Figure 2: S {band.value:.2f} [{band.low:.2f}, {band.high:.2f}], true 11")
    print(f"          J {jump.value:.2f} [{jump.low:.2f}, {jump.high:.2f}], true 3: vague, because")
    print("          a constant set-point shows only how far the stem moves times the gain")
    for name, trace in figure_3(options.out).items():
        error = np.concatenate([(trace.pv - trace.sp)[part] for part in SETTLED])
        moves = sum(int(np.count_nonzero(np.diff(trace.stem[part]))) for part in SETTLED)
        print(f"Figure 3, {name}: PV deviates by {np.std(error):.3f}, stem moves: {moves}")
    chem_10(options.data)


if __name__ == "__main__":
    main()
