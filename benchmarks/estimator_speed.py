"""How fast the estimator is on one core: ``python -m benchmarks.estimator_speed``.

Candidate-samples per second of the kernels and of the whole coarse pass, beside a bare
multiply-add over the same lanes (what the hardware allows NumPy's BLAS), and seconds per window.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.report import machine, table
from compensator.study import EXAMPLE_1, Study, run
from compensator.unaware import UnawareMpc
from estimator import identify, warm_up
from estimator._kernels import lag
from estimator.coarse import LAGS, coarse_costs, coarse_valves
from estimator.search import stem_of
from estimator.structures import COARSE, Structure
from estimator.window import harmonise


def best_of(action: Callable[[], object], repeats: int = 7) -> float:
    """Least processor seconds of ``action`` over ``repeats`` runs."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        action()
        spent.append(time.process_time() - begun)
    return min(spent)


def sticky_window(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """OP and PV of the paper's Example 1 under its unaware MPC, a window from mid-cycle."""
    study = Study(
        setpoint=[(0, 50.0), (300, 55.0), (700, 48.0), (1100, 53.0)],
        samples=samples + 400,
        equation_noise=1e-2,
        seed=1,
    )
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, UnawareMpc(EXAMPLE_1.process), study)
    return trace.op[-samples:], trace.pv[-samples:]


def measure(samples: int) -> dict[str, float]:
    op, pv = sticky_window(samples)
    window = harmonise(op, pv, None, None, 1.0)
    valves = coarse_valves()
    stem, _ = stem_of(window.u, *valves)
    work = stem.size
    structure = Structure.of_time_constants(6.0)
    factors = np.random.default_rng(0).normal(size=(24, samples))

    def coarse() -> None:
        signal, _ = stem_of(window.u, *valves)
        for process in COARSE:
            response = process.response(signal)
            coarse_costs(window.y, window.good, response, process, LAGS)

    healthy = op + np.random.default_rng(1).normal(scale=0.01, size=samples)
    seconds = {
        "stems": best_of(lambda: stem_of(window.u, *valves)),
        "lag": best_of(lambda: lag(stem, structure.slow)),
        "bare multiply-add": best_of(lambda: factors @ stem) / factors.shape[0],
        "coarse": best_of(coarse, 3),
    }
    candidates = work * len(COARSE) * len(LAGS)
    return {
        "samples": float(samples),
        "stem candidate-samples per second": work / seconds["stems"],
        "lag candidate-samples per second": work / seconds["lag"],
        "bare multiply-adds per second": work / seconds["bare multiply-add"],
        "coarse pass candidate-samples per second": candidates / seconds["coarse"],
        "coarse pass seconds": seconds["coarse"],
        "sticky window seconds": best_of(lambda: identify(op, pv), 3),
        "unrelated PV seconds": best_of(lambda: identify(healthy, np.roll(pv, 500)), 3),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    warm_up()
    with threadpool_limits(limits=1, user_api="blas"):
        figures = measure(options.samples)
    print(table(("figure", "value"), list(figures.items())))
    if options.json is not None:
        options.json.write_text(json.dumps({"machine": machine(), **figures}, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
