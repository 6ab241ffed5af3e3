"""Is ARMAX worth its trouble? Gain and poles of ARX and ARMAX given the true stem.

    python -m benchmarks.linear_part [--runs 20] [--out docs/benchmarks]

The paper's examples, with the noise where the paper puts it (in the equation) and as white noise on
PV of the size that the equation noise makes there. What remains is the error of the linear part
alone: the stem is never known that well.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.examples import EXAMPLES, Example
from benchmarks.report import heading, keep, machine, table
from compensator.conventional.unaware import UnawareMpc
from estimator.processes.armax import ArmaxFit, ArmaxOrders, armax
from fieldlink.lab.study.closed_loop import Study, held_stem_std, run

__all__ = ["main", "order_choice"]

_CANDIDATES = tuple((na, nb) for na in (1, 2, 3) for nb in (1, 2, 3))


@dataclass(frozen=True, slots=True)
class _Window:
    stem: np.ndarray
    pv: np.ndarray


def _window(example: Example, seed: int, *, measured: bool) -> _Window:
    """1,000 samples of the closed loop, its noise in the equation or on PV."""
    begin = 500
    size = held_stem_std(example.process, example.noise, 0.0)
    study = Study(
        setpoint=((0, 50.0), (50, 55.0)),
        samples=begin + 1000,
        equation_noise=0.0 if measured else example.noise,
        measurement_noise=size if measured else 0.0,
        seed=seed,
    )
    trace = run(example.process, example.valve, UnawareMpc(example.process), study)
    return _Window(trace.stem[begin:], trace.pv[begin:])


def order_choice(stem: np.ndarray, pv: np.ndarray, *, noise: bool) -> ArmaxFit:
    """The fit with the lowest BIC per row: ARX, or ARMAX with ``nc = na``."""
    fits = [
        armax(stem, pv, ArmaxOrders(na, nb, na if noise else 0, dead_time=1))
        for na, nb in _CANDIDATES
    ]
    return min(fits, key=lambda fit: fit.bic / fit.rows)


def _fixed(nc: int) -> Callable[[_Window], ArmaxFit]:
    return lambda window: armax(window.stem, window.pv, ArmaxOrders(3, 3, nc))


def _chosen(noise: bool) -> Callable[[_Window], ArmaxFit]:
    return lambda window: order_choice(window.stem, window.pv, noise=noise)


_MODELS: dict[str, Callable[[_Window], ArmaxFit]] = {
    "arx(3,3)": _fixed(0),
    "armax(3,3,3)": _fixed(3),
    "arx, orders by BIC": _chosen(False),
    "armax, orders by BIC": _chosen(True),
}


def _errors(fit: ArmaxFit, example: Example) -> tuple[float, float]:
    gain = 100.0 * abs(fit.process.gain / example.process.gain - 1.0)
    slow = float(np.abs(np.roots([1.0, *fit.a])).max())
    true = float(np.abs(np.roots([1.0, *example.process.a])).max())
    if not 0.0 < slow < 1.0:
        return gain, math.inf
    return gain, 100.0 * abs(math.log(true) / math.log(slow) - 1.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="windows of each case")
    parser.add_argument("--out", type=Path, help="folder for linear_part.md and .json")
    options = parser.parse_args(arguments)
    header = (
        "example", "noise", "model", "gain error %", "gain, p90", "slow time constant error %",
        "p90",
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for example in EXAMPLES:
        for measured in (False, True):
            windows = [_window(example, seed, measured=measured) for seed in range(options.runs)]
            for name, fit in _MODELS.items():
                found = np.array([_errors(fit(window), example) for window in windows])
                gain, slow = (np.quantile(found[:, i], [0.5, 0.9], method="lower") for i in (0, 1))
                kind = "white, on PV" if measured else "in the equation"
                rows.append((example.name, kind, name, *gain.tolist(), *slow.tolist()))
    text = f"{heading('linear_part', __doc__, arguments)}\n\n{table(header, rows)}"
    print(text)
    figures = {
        "options": {"runs": options.runs},
        "machine": machine(),
        "table": [dict(zip(header, row, strict=True)) for row in rows],
    }
    keep(options.out, "linear_part", text, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
