"""No write that today's rules forbid, whatever comes together; the benchmark runs it longer."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from tests.daemon.writeback_machine import WritebackMachine

TestNoForbiddenWrite = WritebackMachine.TestCase
TestNoForbiddenWrite.settings = settings(
    max_examples=100,
    stateful_step_count=50,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
