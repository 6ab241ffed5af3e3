"""The live daemon: polls on monotonic deadlines, judges windows, writes back, until told to stop.

Every device has two tasks of its own, one that polls and one that writes back, so a silent device
delays nobody else and a slow write delays no poll. Windows are judged in other processes on the
scheduler's beat; records go to a thread. The event loop itself only waits.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from functools import partial

from fieldlink.daemon.assembly import Assembly
from fieldlink.daemon.device import DeviceRunner
from fieldlink.daemon.pipeline import LoopPipeline
from fieldlink.daemon.pool import EstimatorPool, PoolSettings
from fieldlink.daemon.schedule import Schedule
from fieldlink.daemon.status import DaemonStatus
from fieldlink.links import Clock, SystemClock
from fieldlink.site import Site
from fieldlink.store import Historian, HistorianSettings

__all__ = ["Daemon"]

STOP_GRACE = 5.0
"""Seconds that windows being judged and writes under way have to finish when the daemon stops."""


class Daemon:
    """Runs a site against its real devices.

    Args:
        site: the site.
        read_only: never write to any device, whatever the site file says.
        store: sizes and patience of the historian.
        pool: size and patience of the estimator's processes.
        clock: stamps readings and gives the deadlines.
    """

    def __init__(
        self,
        site: Site,
        *,
        read_only: bool = False,
        store: HistorianSettings | None = None,
        pool: PoolSettings | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._site = site
        self._clock = clock or SystemClock()
        self._historian = Historian(
            site.historian_url, store, retention_days=site.historian.retention_days
        )
        self._assembly = Assembly(
            site, self._clock, self._historian.put, read_only=read_only, live=True
        )
        self._pool_settings = pool
        self._pool: EstimatorPool | None = None
        self._judging: set[asyncio.Task[None]] = set()

    def status(self) -> DaemonStatus:
        """Return a snapshot; may be called at any time."""
        rebuilt = 0 if self._pool is None else self._pool.rebuilt
        return self._assembly.status(self._historian.report(), rebuilt)

    async def run(
        self, duration: float | None = None, stop: asyncio.Event | None = None
    ) -> DaemonStatus:
        """Run until ``stop`` is set or ``duration`` wall seconds have passed.

        Returns:
            The last status.

        Raises:
            StoreError: the historian cannot be opened.
            FieldlinkError: a link that cannot ever work.
        """
        journal = self._assembly.journal
        self._historian.start(journal.event_record("daemon.start", "daemon", self._site.name))
        try:
            self._pool = EstimatorPool(self._pool_settings)
            try:
                await self._assembly.open()
                async with self._at_work() as failures:
                    await _until(stop, duration, failures)
            finally:
                await self._assembly.close()
                await self._pool.close()
        except BaseException as error:
            journal.event("daemon.failed", "daemon", repr(error), bad=True)
            raise
        else:
            journal.event("daemon.stop", "daemon", "stopped as asked")
        finally:
            await asyncio.to_thread(self._historian.stop)
        return self.status()

    @asynccontextmanager
    async def _at_work(self) -> AsyncIterator[list[asyncio.Future[None]]]:
        """Start everything; yield what must not end by itself; end it in order."""
        assert self._pool is not None
        ending = asyncio.Event()
        schedule = Schedule()
        warming = _spawn(self._pool.warm_up(), "warm-up")
        forever: list[asyncio.Task[None]] = []
        for runner in self._assembly.runners.values():
            polled = asyncio.Event()
            forever.append(_spawn(self._poll(runner, polled, ending), f"poll {runner.name}"))
            if runner.writes:
                forever.append(
                    _spawn(self._service(runner, polled, ending), f"write {runner.name}")
                )
            for pipeline in runner.pipelines.values():
                seconds = pipeline.loop.estimate_period / runner.speed
                schedule.every(
                    seconds, pipeline.name, partial(self._judge, schedule, runner, pipeline, ending)
                )
        schedule.start()
        try:
            yield [schedule.failed, *forever]
        finally:
            ending.set()
            schedule.pause()
            warming.cancel()
            unfinished = await self._finish(forever)
            for task in unfinished:
                self._assembly.journal.event(
                    "daemon.unfinished", "daemon", f"{task.get_name()} was given up", bad=True
                )
                task.cancel()
            await asyncio.gather(warming, *unfinished, return_exceptions=True)
            schedule.stop()

    async def _finish(self, tasks: list[asyncio.Task[None]]) -> set[asyncio.Task[None]]:
        """Wait for tasks and for windows being judged; return those that were not done in time."""
        deadline = self._clock.monotonic() + STOP_GRACE
        while True:
            # A turn for jobs that have been started and have not run yet.
            await asyncio.sleep(0)
            left = {task for task in (*tasks, *self._judging) if not task.done()}
            seconds = deadline - self._clock.monotonic()
            if not left or seconds <= 0.0:
                return left
            await asyncio.wait(left, timeout=seconds)

    async def _poll(
        self, runner: DeviceRunner, polled: asyncio.Event, ending: asyncio.Event
    ) -> None:
        """Scan at every deadline; a deadline that passed during the scan before is skipped."""
        period = runner.scan_period
        beat = period / runner.speed
        begin = self._clock.monotonic()
        slot = 0
        while not await _wait(ending, begin + slot * beat - self._clock.monotonic()):
            await runner.poll(slot * period)
            polled.set()
            reached = math.floor((self._clock.monotonic() - begin) / beat)
            following = max(slot + 1, reached)
            runner.late += following - slot - 1
            slot = following

    async def _service(
        self, runner: DeviceRunner, polled: asyncio.Event, ending: asyncio.Event
    ) -> None:
        """Let the write-backs run after polls; one that is still at it skips some."""
        begin = self._clock.monotonic()
        while not ending.is_set():
            if not await _wait(polled, 1.0):
                continue
            polled.clear()
            await runner.service((self._clock.monotonic() - begin) * runner.speed)

    async def _judge(
        self,
        schedule: Schedule,
        runner: DeviceRunner,
        pipeline: LoopPipeline,
        ending: asyncio.Event,
    ) -> None:
        if ending.is_set():
            return
        missing = pipeline.samples_until_estimate
        if missing:
            schedule.postpone(pipeline.name, missing * pipeline.loop.period / runner.speed)
            return
        task = asyncio.current_task()
        assert task is not None
        assert self._pool is not None
        self._judging.add(task)
        try:
            runner.accept(await self._pool.run(pipeline.request()))
        finally:
            self._judging.discard(task)


def _spawn(work: Coroutine[object, object, None], name: str) -> asyncio.Task[None]:
    return asyncio.create_task(work, name=name)


async def _wait(event: asyncio.Event, seconds: float) -> bool:
    """Wait for an event for at most so many seconds; return whether it is set."""
    try:
        async with asyncio.timeout(max(0.0, seconds)):
            await event.wait()
    except TimeoutError:
        return False
    return True


async def _until(
    stop: asyncio.Event | None, duration: float | None, failures: list[asyncio.Future[None]]
) -> None:
    """Wait for the end; raise when something ended that must not."""
    asked = _spawn(_forever(stop), "stop")
    try:
        done, _ = await asyncio.wait(
            [asked, *failures], timeout=duration, return_when=asyncio.FIRST_COMPLETED
        )
        for future in done:
            future.result()
    finally:
        asked.cancel()


async def _forever(stop: asyncio.Event | None) -> None:
    await (stop or asyncio.Event()).wait()
