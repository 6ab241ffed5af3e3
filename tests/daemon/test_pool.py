"""Whatever a worker does, a request ends with an outcome."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np
import pytest

from fieldlink.daemon.estimation.estimating import (
    Estimate,
    EstimateOutcome,
    EstimateRequest,
    estimate,
)
from fieldlink.daemon.estimation.pool import EstimatorPool, PoolSettings
from fieldlink.daemon.estimation.priority import NICENESS
from fieldlink.daemon.windows.window import WindowData
from loop_model import ProcessModel, ValveModel


def request(loop: str = "FC101", op: object = None) -> EstimateRequest:
    k = np.arange(300.0)
    values = np.sin(k / 5.0) if op is None else np.asarray(op, dtype=float)
    return EstimateRequest(
        loop, WindowData(values, np.roll(values, 1), None, None, 0, values.size - 1, 9.0), 1.0
    )


def answer(asked: EstimateRequest) -> Estimate:
    return Estimate.failed(asked, EstimateOutcome.REFUSED, f"{os.getpid()}")


def misbehave(asked: EstimateRequest) -> Estimate:
    if asked.loop == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.loop == "hang":
        time.sleep(3600.0)
    return answer(asked)


def devour(asked: EstimateRequest) -> Estimate:
    taken = np.ones(100_000_000)
    return Estimate.failed(asked, EstimateOutcome.REFUSED, f"{taken.sum()}")


def stumble(asked: EstimateRequest) -> Estimate:
    raise ZeroDivisionError(f"in {asked.loop}")


def stop_yourself(_: EstimateRequest) -> Estimate:
    os.kill(os.getpid(), signal.SIGSTOP)
    raise AssertionError("stopped")


def tell_priority(asked: EstimateRequest) -> Estimate:
    niceness = os.getpriority(os.PRIO_PROCESS, 0)
    own_session = os.getsid(0) == os.getpid()
    said = f"{niceness} {os.sched_getscheduler(0) == os.SCHED_BATCH} {own_session}"
    return Estimate.failed(asked, EstimateOutcome.REFUSED, said)


def nothing() -> None:
    pass


def compile_for_long() -> None:
    time.sleep(3.0)


def fail() -> None:
    raise RuntimeError("no kernels")


@asynccontextmanager
async def pool_of(
    work: Callable[[EstimateRequest], Estimate],
    prepare: Callable[[], None] = nothing,
    **settings: float,
) -> AsyncIterator[EstimatorPool]:
    options = {"workers": 1, "limit": 20.0, "grace": 5.0} | settings
    pool = EstimatorPool(PoolSettings(**options), work, prepare)  # type: ignore[arg-type]
    try:
        yield pool
    finally:
        await pool.close()


async def test_a_window_is_judged_in_another_process() -> None:
    async with pool_of(answer) as pool:
        await pool.warm_up()
        outcome = await pool.run(request())
        assert outcome.message in map(str, pool.worker_ids())
    assert outcome.message != str(os.getpid())


async def test_a_window_that_kills_its_worker_is_reported_and_others_go_on() -> None:
    async with pool_of(misbehave) as pool:
        killed, fine = await asyncio.gather(pool.run(request("kill")), pool.run(request("fine")))
        assert killed.outcome is EstimateOutcome.WORKER_DIED
        assert fine.outcome is EstimateOutcome.REFUSED
        assert pool.rebuilt >= 1
        assert (await pool.run(request("later"))).outcome is EstimateOutcome.REFUSED


async def test_a_worker_killed_from_outside_costs_nothing() -> None:
    async with pool_of(answer) as pool:
        await pool.warm_up()
        for process in pool.worker_ids():
            os.kill(process, signal.SIGKILL)
        assert (await pool.run(request())).outcome is EstimateOutcome.REFUSED


async def test_a_window_that_takes_too_long_ends_its_worker() -> None:
    async with pool_of(misbehave, limit=0.3) as pool:
        outcome = await pool.run(request("hang"))
    assert outcome.outcome is EstimateOutcome.WORKER_DIED
    assert "more than 0.3 s" in outcome.message


async def test_a_stopped_worker_is_given_up() -> None:
    async with pool_of(stop_yourself, limit=0.2, grace=1.5) as pool:
        await pool.warm_up()
        outcome = await pool.run(request())
        assert outcome.outcome is EstimateOutcome.TIMED_OUT
        assert pool.rebuilt == 1


async def test_a_worker_that_still_compiles_its_kernels_is_waited_for() -> None:
    async with pool_of(answer, prepare=compile_for_long, limit=0.2, grace=0.2) as pool:
        assert (await pool.run(request())).outcome is EstimateOutcome.REFUSED
        assert pool.rebuilt == 0
    async with pool_of(answer, compile_for_long, limit=0.2, grace=0.2, preparing=0.2) as pool:
        outcome = await pool.run(request())
        assert outcome.outcome is EstimateOutcome.TIMED_OUT
        assert "no result within 0.6 s" in outcome.message


async def test_a_window_that_needs_too_much_memory_is_given_up() -> None:
    async with pool_of(devour, memory=600_000_000) as pool:
        await pool.warm_up()
        before = pool.worker_ids()
        outcome = await pool.run(request())
        assert outcome.outcome is EstimateOutcome.OUT_OF_MEMORY
        # The process goes on: the next window finds it as it was.
        assert pool.worker_ids() == before
        assert pool.report().judged == {"out_of_memory": 1}
    async with pool_of(devour, memory=2_000_000_000, limit=100.0) as pool:
        assert (await pool.run(request())).outcome is EstimateOutcome.REFUSED


async def test_a_defect_is_an_outcome() -> None:
    async with pool_of(stumble) as pool:
        outcome = await pool.run(request("FC7"))
        assert outcome.outcome is EstimateOutcome.FAILED
        assert "in FC7" in outcome.message
        assert "test_pool.py" in outcome.message
        assert pool.rebuilt == 0


@pytest.mark.skipif(sys.platform != "linux", reason="scheduling classes are Linux'")
async def test_workers_let_the_daemon_go_first() -> None:
    async with pool_of(tell_priority) as pool:
        outcome = await pool.run(request())
    assert outcome.message == f"{max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0))} True True"


async def test_workers_that_cannot_begin_are_reported() -> None:
    async with pool_of(answer, prepare=fail) as pool:
        await pool.warm_up()
        assert (await pool.run(request())).outcome is EstimateOutcome.WORKER_DIED


def test_what_is_no_window_is_refused_with_the_reason() -> None:
    outcome = estimate(request(op=[np.nan] * 300))
    assert outcome.outcome is EstimateOutcome.REFUSED
    assert "no finite sample" in outcome.message
    assert outcome.record(10.0).outcome == "refused"


async def test_the_real_estimator_answers_from_the_pool() -> None:
    rng = np.random.default_rng(7)
    k = np.arange(600.0)
    op = 50.0 + 6.0 * np.abs((k / 40.0) % 2.0 - 1.0)
    stem = ValveModel(stick_band=4.0, slip_jump=1.0).simulate(op, 50.0)
    process = ProcessModel(a=(-0.8,), b=(0.2,), dead_time=1, offset=0.0, period=1.0)
    pv = process.simulate(stem) + 0.02 * rng.standard_normal(k.size)
    asked = EstimateRequest("FC101", WindowData(op, pv, None, None, 100, 699, 9.0), 1.0)
    pool = EstimatorPool(PoolSettings(workers=1))
    try:
        outcome = await pool.run(asked)
    finally:
        await pool.close()
    assert outcome.findings is not None
    assert outcome.findings.verdict == "stiction"
    assert outcome.findings.stick_band.value == pytest.approx(4.0, rel=0.1)
    assert outcome.findings.model is not None
    record = outcome.record(10.0)
    assert (record.first_slot, record.last_slot, record.verdict) == (100, 699, "stiction")
