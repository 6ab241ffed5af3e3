"""Whatever happens on the wire: no wrong value is stored as good, and the daemon recovers.

The registers prove themselves (`plant`), so that every stored sample can be judged by itself: with
its slot (the controller's own cycle) go exactly one OP and one PV of that loop.
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from fieldlink.daemon import Daemon, DaemonStatus
from fieldlink.links import LinkState
from fieldlink.site import load_site
from fieldlink.store import HistorianSettings, read_samples
from tests.faults import plant, proxy
from tests.serial_lines import line_to_port

TIMEOUT = 0.1
PATIENCE = 60.0
"""Seconds: the time-out of the device without faults; a busy machine must not look like one."""
STORE = HistorianSettings(linger=0.02)


@dataclass(frozen=True)
class Outcome:
    """What a run left behind.

    Attributes:
        samples: all stored samples.
        status: the daemon's last.
        attempts: connections to the faulty device after the last fault until it answered again.
        alone: time-outs of the faulty device in which the other one was not asked.
        stalls: times that the machine stood still, in all and after the last fault.
        done: faults that were really done, by their number.
    """

    samples: pd.DataFrame
    status: DaemonStatus
    attempts: int
    alone: int
    stalls: tuple[int, int]
    done: dict[Any, int]


class Stalls:
    """Counts the times that the event loop, and so daemon and devices, stood still.

    What stands still in the middle of a request may meet its time-out, whatever the daemon does.
    """

    SHORT = 0.005
    LONG = 0.1 * TIMEOUT

    def __init__(self) -> None:
        self.count = 0

    async def watch(self) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            before = clock()
            await asyncio.sleep(self.SHORT)
            self.count += clock() - before > self.SHORT + self.LONG


async def until(condition: Callable[[], bool], what: str) -> None:
    for _ in range(20_000):
        if condition():
            return
        await asyncio.sleep(0.005)
    pytest.fail(f"never happened: {what}")


async def suffer(framing: str, faults: Iterable[Any], folder: Path) -> Outcome:
    """Run a daemon on two PLCs, one of them behind a proxy with these faults."""
    on_wire = "tcp" if framing == "tcp" else "rtu"
    faulty, fine = plant.SelfCheckingPlc(on_wire), plant.SelfCheckingPlc("tcp")
    await faulty.start()
    await fine.start()
    between = proxy.FaultProxy(faulty.port, on_wire, TIMEOUT, lambda: fine.requests)
    await between.start()
    async with AsyncExitStack() as lines:
        try:
            port = between.port
            if framing == "serial":
                port = await lines.enter_async_context(line_to_port(between.port, folder))
            ports = {"faulty": (port, on_wire), "fine": (fine.port, "tcp")}
            return await endure(between, ports, faults, folder)
        finally:
            await between.stop()
            await faulty.stop()
            await fine.stop()


async def endure(
    between: proxy.FaultProxy,
    ports: dict[str, tuple[int | str, str]],
    faults: Iterable[Any],
    folder: Path,
) -> Outcome:
    """Run the daemon until the faults are over and every loop has samples again."""
    (folder / "map.csv").write_text(plant.map_text())
    (folder / "site.toml").write_text(plant.site_text(ports, {"faulty": TIMEOUT, "fine": PATIENCE}))
    site = load_site(folder / "site.toml")
    daemon, stop = Daemon(site, store=STORE), asyncio.Event()
    run = asyncio.create_task(daemon.run(stop=stop))
    stalls = Stalls()
    watch = asyncio.create_task(stalls.watch())

    def read(loop: str) -> int:
        return daemon.status().loops[loop].counts.read

    try:
        await until(lambda: run.done() or read("faulty.L2") >= 3, "the first samples")
        between.schedule(faults)
        await until(lambda: run.done() or between.over, "the end of the faults")
        during = stalls.count
        await until(lambda: run.done() or between.answered, "an answer")
        before = {loop: read(f"faulty.{loop}") for loop in plant.LOOPS}
        await until(
            lambda: (
                run.done()
                or (
                    all(read(f"faulty.{loop}") >= count + 3 for loop, count in before.items())
                    and daemon.status().devices["faulty"].state is not LinkState.DEMOTED
                )
            ),
            "samples of every loop after the faults",
        )
    finally:
        stop.set()
        status = await run
        watch.cancel()
    return Outcome(
        read_samples(site.historian_url),
        status,
        between.attempts,
        between.alone,
        (stalls.count, stalls.count - during),
        dict(between.done),
    )


def judge(outcome: Outcome) -> None:
    """Assert what must hold after any faults."""
    good = outcome.samples[outcome.samples["quality"] == 0]
    for number, loop in enumerate(plant.LOOPS):
        for device in ("faulty", "fine"):
            mine = good[good["loop"] == f"{device}.{loop}"]
            assert len(mine) >= 3
            assert mine["op"].tolist() == [plant.op_of(number, slot) for slot in mine["slot"]]
            assert mine["pv"].tolist() == [plant.pv_of(number, slot) for slot in mine["slot"]]
            counts = outcome.status.loops[f"{device}.{loop}"].counts
            assert counts.expected == counts.read + counts.missed + counts.bad
            assert counts.restarts == 0
    # The other device is asked meanwhile: what it misses is a busy machine's, not its neighbour's.
    assert outcome.status.devices["fine"].failures == 0
    everywhere, after = outcome.stalls
    assert outcome.alone <= everywhere
    # One attempt when the pause is over; one more may have been under way when the faults ended.
    assert outcome.attempts <= 2 + after


def run(framing: str, faults: Iterable[Any]) -> Outcome:
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(suffer(framing, faults, Path(folder)))


@pytest.mark.parametrize("framing", ["tcp", "rtu", "serial"])
def test_every_fault_alone(framing: str) -> None:
    kinds = {
        "tcp": proxy.TCP_FAULTS, "rtu": proxy.RTU_FAULTS, "serial": proxy.SERIAL_FAULTS,
    }[framing]  # fmt: skip
    faults = [step for kind in kinds for step in (kind, None, None, None, None)]
    outcome = run(framing, faults)
    judge(outcome)
    assert set(outcome.done) == set(kinds)
    harmful = sum(count for kind, count in outcome.done.items() if kind not in proxy.HARMLESS)
    assert outcome.status.devices["faulty"].failures >= harmful // 2


@st.composite
def schedules(draw: st.DrawFn, size: int) -> list[tuple[int, int, int]]:
    """Bursts: (number of a fault, replies that get it, replies that pass before the next)."""
    burst = st.tuples(st.integers(0, size - 1), st.integers(1, 4), st.integers(0, 5))
    return draw(st.lists(burst, min_size=2, max_size=6))


def expand(kinds: tuple[Any, ...], bursts: list[tuple[int, int, int]]) -> list[Any]:
    return [
        step
        for number, replies, pause in bursts
        for step in (*[kinds[number % len(kinds)]] * replies, *[None] * pause)
    ]


RANDOM = settings(
    max_examples=4,
    derandomize=True,
    deadline=None,
    database=None,
    # Shrinking would take minutes; what failed is printed as it was.
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@pytest.mark.slow
@RANDOM
@given(bursts=schedules(17))
def test_random_faults_over_tcp(bursts: list[tuple[int, int, int]]) -> None:
    judge(run("tcp", expand(proxy.TCP_FAULTS, bursts)))


@pytest.mark.slow
@RANDOM
@given(bursts=schedules(13))
def test_random_faults_over_rtu(bursts: list[tuple[int, int, int]]) -> None:
    judge(run("rtu", expand(proxy.RTU_FAULTS, bursts)))


@pytest.mark.slow
@RANDOM
@given(bursts=schedules(9))
def test_random_faults_on_a_serial_line(bursts: list[tuple[int, int, int]]) -> None:
    judge(run("serial", expand(proxy.SERIAL_FAULTS, bursts)))


def test_a_wrong_value_would_be_found() -> None:
    """The judgement above can fail: a value of another cycle or of another loop does not fit."""
    outcome = run("tcp", [])
    judge(outcome)
    for column, at in (("op", 5), ("pv", 7)):
        wrong = outcome.samples.copy()
        wrong.loc[at, column] = wrong.loc[at, column] + 1.0
        with pytest.raises(AssertionError):
            judge(replace(outcome, samples=wrong))
