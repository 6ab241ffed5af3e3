"""No write that today's rules forbid: reloads, operators, kills, lost requests, contradictions.

    python -m benchmarks.writeback_rules --examples 2000

A longer run of the suite's stateful test: random sequences of everything that can happen to a
write-back, beside a PLC that checks every write by the rules of that moment.
"""

from __future__ import annotations

import argparse

from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.daemon.writeback_machine import WritebackMachine

STEPS = 80
"""Things that happen in one sequence: enough for some blocks, a kill and a reload or two."""


def main() -> None:
    """Run; a forbidden write ends it with the shortest sequence that leads to it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--examples", type=int, default=2000)
    options = parser.parse_args()
    run_state_machine_as_test(  # type: ignore[no-untyped-call]
        WritebackMachine,
        settings=settings(
            max_examples=options.examples,
            stateful_step_count=STEPS,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
    print(f"{options.examples} sequences of up to {STEPS} steps, no forbidden write")


if __name__ == "__main__":
    main()
