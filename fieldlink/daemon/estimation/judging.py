"""Judging windows while the daemon runs: on the schedule's beat, and when an operator asks.

A window is judged in another process. What comes back is handed to the loop's runner of that
moment, which drops an answer to a question of another epoch.
"""

from __future__ import annotations

import asyncio
from functools import partial

from fieldlink.daemon.estimation.pool import EstimatorPool, PoolReport, PoolSettings
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.operators.orders import OrderError
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.sampling.tasks import spawn
from fieldlink.daemon.schedule import Schedule
from fieldlink.daemon.site_runner import SiteRunner

__all__ = ["WindowJudging"]


class WindowJudging:
    """Judges the windows of every loop of a site.

    Args:
        site_runner: the loops, and the journal for what goes wrong.
        settings: size and patience of the estimator's processes.

    Attributes:
        tasks: windows that are being judged now.
    """

    def __init__(self, site_runner: SiteRunner, settings: PoolSettings) -> None:
        self._site_runner = site_runner
        self._settings = settings
        self._pool: EstimatorPool | None = None
        # Windows are copied when their turn is near, not all at once.
        self._turns = asyncio.Semaphore(2 * settings.workers)
        self._stopping = False
        self.tasks: set[asyncio.Task[None]] = set()

    @property
    def pool(self) -> EstimatorPool:
        """The estimator's processes, for other work of theirs; there is none before `open`."""
        assert self._pool is not None
        return self._pool

    def open(self) -> None:
        """Make the pool; its processes start with `warm_up` or with the first window."""
        self._pool = EstimatorPool(self._settings)

    async def warm_up(self) -> None:
        """Let every process load the estimator before its first window."""
        assert self._pool is not None
        await self._pool.warm_up()

    async def close(self) -> None:
        """End the processes."""
        assert self._pool is not None
        await self._pool.close()

    def stop(self) -> None:
        """Begin no more windows; those in ``tasks`` may be waited for."""
        self._stopping = True

    def report(self) -> PoolReport:
        """Return the counts up to now."""
        return PoolReport() if self._pool is None else self._pool.report()

    def worker_ids(self) -> tuple[int, ...]:
        """Return the process ids of the estimator's processes."""
        return () if self._pool is None else tuple(self._pool.worker_ids())

    def begin(self, runner: DeviceRunner, schedule: Schedule) -> None:
        """Judge the windows of a device's loops from now on, each every ``estimate_every``."""
        for loop in runner.loops.values():
            seconds = loop.spec.loop.estimate_period / runner.speed
            schedule.every(seconds, _job(loop.name), partial(self._judge, schedule, loop.name))

    def end(self, runner: DeviceRunner, schedule: Schedule) -> None:
        """Judge the windows of a device's loops no more."""
        for loop in runner.loops:
            schedule.remove(_job(loop))

    def judge_by_hand(self, loop: LoopRunner) -> None:
        """Judge a loop's window now because an operator asks for it; returns at once.

        Raises:
            OrderError: the window cannot be judged now.
        """
        if self._pool is None or self._stopping:
            raise OrderError("the daemon is starting or stopping; try again in a moment")
        if loop.pipeline.filled < 1.0:
            raise OrderError(
                f"the window of loop {loop.name} is {loop.pipeline.filled:.0%} full; it is judged "
                "when it is full"
            )
        name = f"{_job(loop.name)} by hand"
        if any(task.get_name() == name for task in self.tasks):
            raise OrderError(f"the window of loop {loop.name} is being judged already")
        self.tasks.add(spawn(self._judge_window(loop.name, loop, by_hand=True), name))

    async def _judge(self, schedule: Schedule, loop: str) -> None:
        async with self._turns:
            runner = self._site_runner.runner_of(loop)
            if runner is None or self._stopping:
                return
            asking = runner.loops[loop]
            missing = asking.pipeline.samples_until_estimate
            if missing:
                period = asking.spec.loop.period
                schedule.postpone(_job(loop), missing * period / runner.speed)
                return
            await self._judge_window(loop, asking)

    async def _judge_window(self, loop: str, asking: LoopRunner, *, by_hand: bool = False) -> None:
        task = asyncio.current_task()
        assert task is not None
        assert self._pool is not None
        if not by_hand:
            task.set_name(_job(loop))
        self.tasks.add(task)
        try:
            request = asking.request(by_hand=by_hand)
            estimate = await self._pool.run(request)
            # The site file may have been changed meanwhile: the runner of today decides.
            answered = self._site_runner.loop(loop)
            if answered is not None:
                answered.accept(estimate, request)
        except Exception as error:  # noqa: BLE001  (logged as a defect; the other loops go on)
            self._site_runner.journal.defect(loop, error, "this estimate is left out")
        finally:
            self.tasks.discard(task)


def _job(loop: str) -> str:
    return f"estimate {loop}"
