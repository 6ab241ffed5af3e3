"""Compensation on the tuning family: the loops that the compensator's settings are chosen on.

``python -m benchmarks.compensation_tuning`` runs and judges them as `benchmarks.compensation_apart`
does its own; no figure of it is reported. ``--only`` takes the rows whose words hold a text, as in
``--only "long delay"``, and ``--without-identification`` leaves out what takes longest.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

from benchmarks.apart.loops import DISTURBANCES, WRONG
from benchmarks.compensation_apart import list_rows, run
from benchmarks.tuned.linear_plants import PROCESSES, VALVES
from benchmarks.tuned.tuning_loops import TunedLoop

__all__ = ["main", "rows_to_run"]


def rows_to_run() -> Iterator[tuple[TunedLoop, str, str]]:
    """Return loop, parameters and disturbance of every row."""
    kinds = [valve for valve in VALVES if valve != "steady"]
    for place, process in enumerate(PROCESSES):
        for number, valve in enumerate(kinds):
            own = ("pi", "mpc")[(number + place) % 2]
            loop = TunedLoop.of(process, valve, own, driven=number == 2)
            wrong = tuple(WRONG) if number == place % len(kinds) else ("exact",)
            for parameters in (*wrong, "identified"):
                yield loop, parameters, "none"
            if "sign wrong" not in wrong:
                yield loop, "sign wrong", "none"
        # An MPC that chases the measurement's noise: little deviation to gain, much travel.
        for valve in kinds if PROCESSES[process].integrating else ():
            restless = TunedLoop.of(process, valve, "restless")
            for parameters in ("exact", "gain x 0.8", "identified"):
                yield restless, parameters, "none"
        for loop in (
            TunedLoop.of(process, "varying", ("pi", "mpc")[place % 2]),
            TunedLoop.of(process, "steady", "calm"),
        ):
            for disturbance in DISTURBANCES[1:]:
                yield loop, "exact", disturbance


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run only rows whose words contain this text")
    parser.add_argument("--without-identification", action="store_true")
    parser.add_argument("--seed", type=int, default=101)
    options = parser.parse_args(arguments)
    rows = [
        run(loop, parameters, disturbance, options.seed)
        for loop, parameters, disturbance in rows_to_run()
        if options.only in f"{loop.process}, {loop.valve}, {loop.own}, {parameters}, {disturbance}"
        and not (options.without_identification and parameters == "identified")
    ]
    print(list_rows(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
