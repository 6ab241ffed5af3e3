"""A wall clock that steps changes the stamps of samples, and nothing else."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import textwrap
import time
from datetime import datetime, tzinfo
from pathlib import Path

import apscheduler.schedulers.base
import apscheduler.triggers.interval
import pytest

import fieldlink.daemon.schedule
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.schedule import Schedule
from fieldlink.links import VirtualClock
from fieldlink.store import StoreError, read_estimates, read_events, read_samples

HOUR = 3600.0


class Adjustable(VirtualClock):
    """A clock whose time of day can be set."""

    error = 0.0

    def utc(self) -> float:
        return super().utc() + self.error


def test_steps_are_seen_once_and_drift_is_not() -> None:
    clock = Adjustable(1e9)
    watch = ClockWatch(clock)
    clock.advance_to(1.0)
    assert watch.look() == 0.0
    clock.error = -2.0 * HOUR
    clock.advance_to(2.0)
    assert watch.look() == pytest.approx(-2.0 * HOUR)
    clock.advance_to(3.0)
    assert watch.look() == 0.0
    for second in range(4, 100):
        clock.error += 0.5
        clock.advance_to(float(second))
        assert watch.look() == 0.0
    clock.error += 5.0 * HOUR
    assert watch.look() == pytest.approx(5.0 * HOUR)
    assert watch.steps == 2


def test_a_stamp_belongs_to_the_stretch_that_it_was_made_in() -> None:
    clock = Adjustable(1e9)
    watch = ClockWatch(clock)
    before = 1e9
    assert watch.stretch_of(before + 0.1) == 0
    # A reading is the first to show the step, one that was made earlier comes after it.
    assert watch.stretch_of(before - HOUR) == 1
    assert watch.stretch_of(before) == 0
    assert watch.stretch_of(before - HOUR) == 1
    clock.error = -HOUR
    assert watch.look() == pytest.approx(-HOUR, abs=0.2)
    assert watch.look() == 0.0
    # Back to where it was is a step, too.
    clock.error = 0.0
    assert watch.look() == pytest.approx(HOUR, abs=0.2)
    assert watch.stretch_of(before) == 2


class ShiftedDatetime(datetime):
    """The machine's time of day, stepped by ``shift`` seconds."""

    shift = 0.0

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:
        return datetime.fromtimestamp(time.time() + cls.shift, tz)


@pytest.fixture
def time_of_day(monkeypatch: pytest.MonkeyPatch) -> type[ShiftedDatetime]:
    monkeypatch.setattr(ShiftedDatetime, "shift", 0.0)
    for module in (
        apscheduler.schedulers.base,
        apscheduler.triggers.interval,
        fieldlink.daemon.schedule,
    ):
        monkeypatch.setattr(module, "datetime", ShiftedDatetime)
    return ShiftedDatetime


@pytest.mark.parametrize("step", [-3.0 * HOUR, 3.0 * HOUR])
async def test_jobs_go_on_after_a_step(time_of_day: type[ShiftedDatetime], step: float) -> None:
    runs = 0

    async def job() -> None:
        nonlocal runs
        runs += 1

    schedule = Schedule()
    schedule.every(0.05, "job", job)
    schedule.start()
    try:
        while runs < 3:
            await asyncio.sleep(0.01)
        time_of_day.shift += step
        schedule.clock_stepped(step)
        before = runs
        while runs < before + 3:
            await asyncio.sleep(0.01)
        # Moved along, not fired for every interval that the clock jumped over.
        assert runs < before + 20
    finally:
        schedule.stop()


async def test_without_being_told_they_would_wait(time_of_day: type[ShiftedDatetime]) -> None:
    """What is cured above: without it this would hang for three hours."""
    runs = 0

    async def job() -> None:
        nonlocal runs
        runs += 1

    schedule = Schedule()
    schedule.every(0.02, "job", job)
    schedule.start()
    try:
        while runs < 2:
            await asyncio.sleep(0.01)
        time_of_day.shift -= 3.0 * HOUR
        await asyncio.sleep(0.1)
        before = runs
        await asyncio.sleep(0.3)
        assert runs == before
        schedule.clock_stepped(-3.0 * HOUR)
        while runs == before:
            await asyncio.sleep(0.01)
    finally:
        schedule.stop()


def find_libfaketime() -> str:
    for place in ("/usr/lib", "/usr/local/lib"):
        for found in Path(place).glob("**/faketime/libfaketime.so.1"):
            return str(found)
    pytest.skip("the clock can be stepped with libfaketime only: apt-get install libfaketime")


PROGRAM = textwrap.dedent(
    """
    import asyncio, os, sys
    from pathlib import Path

    # The estimator's processes may know the time.
    del os.environ["LD_PRELOAD"]

    from tests.daemon import live
    from tests.links.fake_device import FakeDevice
    from fieldlink.daemon import Daemon, configure_logging, stop_on_signals

    async def main():
        configure_logging()
        device = FakeDevice()
        await device.start()
        site = live.site_for(Path(sys.argv[1]), {"plc": device.port}, window=60,
                              estimate_every=20.0)
        async with live.plant_on(device):
            with stop_on_signals() as stop:
                await Daemon(site, pool=live.POOL, store=live.STORE).run(stop=stop)
        await device.stop()

    if __name__ == "__main__":
        asyncio.run(main())
    """
)


@pytest.mark.slow
def test_the_real_clock_is_set_back_and_forth_by_hours(tmp_path: Path) -> None:
    library = find_libfaketime()
    script, setting = tmp_path / "program.py", tmp_path / "time"
    script.write_text(PROGRAM)
    setting.write_text("+0")
    environment = os.environ | {
        "LD_PRELOAD": library,
        "PYTHONPATH": str(Path(__file__).resolve().parents[2]),
        "FAKETIME_TIMESTAMP_FILE": str(setting),
        "FAKETIME_CACHE_DURATION": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    url = f"sqlite:///{tmp_path}/data/history.sqlite"
    with subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        try:
            for text in ("-3h", "+5h"):
                wait_for_more(url, process)
                setting.write_text(text)
                wait_for_step(url, process, "-3" if text == "-3h" else "+8")
            wait_for_more(url, process)
        finally:
            process.terminate()
            _, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    samples, events = read_samples(url).sort_values("slot"), read_events(url)
    assert samples["clock_steps"].is_monotonic_increasing
    # Sampling never stopped: what a busy machine misses is little, an hour would be much.
    assert samples["slot"].diff().max() < 500
    for steps, hours in ((0, 0), (1, -3), (2, 5)):
        marked = samples[samples["clock_steps"] == steps]
        assert len(marked) > 20
        ahead = (marked["time"].iloc[-1] - samples["time"].iloc[0]).total_seconds() / HOUR
        assert round(ahead) == hours
    assert events["kind"].tolist().count("clock.stepped") == 2


def wait_for_more(url: str, process: subprocess.Popen[str]) -> None:
    """Wait for new samples and a new estimate: neither may stand still."""
    before = seen(url)
    for _ in range(4000):
        now = seen(url)
        if now[0] >= before[0] + 30 and now[1] >= before[1] + 1:
            return
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    pytest.fail(f"neither samples nor estimates may stop: {before} and then {seen(url)}")


def wait_for_step(url: str, process: subprocess.Popen[str], hours: str) -> None:
    for _ in range(2000):
        messages = read_events(url).query("kind == 'clock.stepped'")["message"]
        # Three hours are 10800 seconds, eight (from -3 to +5) are 28800.
        wanted = {"-3": "-10800", "+8": "+28800"}[hours]
        if any(wanted[:4] in message or "-1079" in message or "+2879" in message
               for message in messages):  # fmt: skip
            return
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    pytest.fail("the step was not noticed")


def seen(url: str) -> tuple[int, int]:
    try:
        return len(read_samples(url)), len(read_estimates(url))
    except StoreError:
        return 0, 0
