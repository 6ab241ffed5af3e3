"""The devices that are being polled: started one after the other, watched, and ended in order."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.sampling.tasks import DeviceTasks
from fieldlink.links import Clock

__all__ = ["DevicesAtWork"]

STOP_GRACE = 5.0
"""Seconds that windows being judged and writes under way have to finish when the daemon stops."""


class DevicesAtWork:
    """Keeps the tasks of every device.

    Args:
        clock: gives the deadlines.
        journal: takes what had to be given up.

    Attributes:
        tasks: by the device's name.
    """

    def __init__(self, clock: Clock, journal: Journal) -> None:
        self._clock = clock
        self._journal = journal
        self._failed: asyncio.Future[None] | None = None
        self.tasks: dict[str, DeviceTasks] = {}

    def watch(self) -> asyncio.Future[None]:
        """Return a future that carries the error of a device's task that ended by one."""
        self._failed = asyncio.get_running_loop().create_future()
        return self._failed

    def stop_watching(self) -> None:
        """Carry no more errors."""
        if self._failed is not None:
            self._failed.cancel()

    def stuck(self) -> tuple[str, ...]:
        """Name the devices whose polling task has not had its turn for much too long."""
        return tuple(f"device {name}" for name, tasks in self.tasks.items() if tasks.stuck)

    def begin_all(self, runners: Iterable[DeviceRunner]) -> None:
        """Start all devices; those with the same period are not all asked in the same moment."""
        starting = list(runners)
        now = self._clock.monotonic()
        for number, runner in enumerate(starting):
            beat = runner.scan_period / runner.speed
            self.begin(runner, now + beat * number / len(starting))

    def begin(self, runner: DeviceRunner, begin: float) -> None:
        """Start a device; ``begin`` is the monotonic second of its plant second 0."""
        tasks = DeviceTasks(runner, self._clock, begin)
        tasks.start()
        self.tasks[runner.name] = tasks
        for task in tasks.running:
            task.add_done_callback(self._note_end)

    async def end(
        self, devices: Iterable[DeviceTasks], others: Iterable[asyncio.Task[None]] = ()
    ) -> None:
        """End devices and wait for what is under way; what takes too long is cancelled."""
        ending = list(devices)
        for tasks in ending:
            tasks.end()
        deadline = self._clock.monotonic() + STOP_GRACE
        while True:
            # A turn for jobs that have been started and have not run yet.
            await asyncio.sleep(0)
            running = (task for tasks in ending for task in tasks.running)
            left = {task for task in (*running, *others) if not task.done()}
            seconds = deadline - self._clock.monotonic()
            if not left or seconds <= 0.0:
                break
            await asyncio.wait(left, timeout=seconds)
        for task in left:
            self._journal.event(
                "daemon.unfinished",
                "daemon",
                f"{task.get_name()} did not end within {STOP_GRACE:g} s and was given up",
                bad=True,
            )
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    def account_for_open_slots(self) -> None:
        """Count what has not come up to now as missed; to be called when the tasks have ended."""
        for tasks in self.tasks.values():
            tasks.account_for_open_slots()

    def _note_end(self, task: asyncio.Task[None]) -> None:
        """Let an error of a device's task end the daemon: going on without it would be silent."""
        if task.cancelled() or self._failed is None or self._failed.done():
            return
        if (error := task.exception()) is not None:
            self._failed.set_exception(error)
