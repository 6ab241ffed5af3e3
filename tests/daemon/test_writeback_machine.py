"""No write that today's rules forbid, whatever comes together; the benchmark runs it longer."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.daemon.writeback_machine import WritebackMachine


def test_no_write_that_todays_rules_forbid() -> None:
    run_state_machine_as_test(
        WritebackMachine,
        settings=settings(
            max_examples=100,
            stateful_step_count=50,
            deadline=None,
            derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )
