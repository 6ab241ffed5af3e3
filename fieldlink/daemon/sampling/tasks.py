"""The two tasks of a device: one polls on monotonic deadlines, one lets the write-backs run.

So a slow write delays no poll, and no device delays another.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine, Sequence

from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.links import Clock
from fieldlink.registers import HEARTBEAT_EVERY

__all__ = ["DeviceTasks", "spawn", "wait_for", "wait_for_end"]

STUCK_AFTER = 30.0
"""Seconds beyond three polls without a turn of the polling task after which it counts as stuck."""


class DeviceTasks:
    """Runs a device's runner.

    Args:
        runner: the device, with its link open.
        clock: gives the deadlines.
        begin: the moment (monotonic seconds) of plant second 0, which is that of the first poll.
    """

    def __init__(self, runner: DeviceRunner, clock: Clock, begin: float) -> None:
        self.runner = runner
        self.begin = begin
        self._clock = clock
        self._ending = asyncio.Event()
        self._turn = clock.monotonic()
        self.running: tuple[asyncio.Task[None], ...] = ()

    def start(self) -> None:
        """Begin; the tasks end only by `end`, or by an error that must not be."""
        name = self.runner.name
        tasks = [spawn(self._poll(), f"poll {name}")]
        if self.runner.writes:
            tasks.append(spawn(self._service(), f"write {name}"))
        self.running = tuple(tasks)

    def end(self) -> None:
        """Begin nothing more; what is under way may be waited for in ``running``."""
        self._ending.set()

    def account_for_open_slots(self) -> None:
        """Count what has not come up to now as missed; to be called when the tasks have ended."""
        elapsed = self._clock.monotonic() - self.begin
        self.runner.account_for_open_slots(elapsed * self.runner.speed)

    @property
    def stuck(self) -> bool:
        """Whether the polling task has not had its turn for much too long."""
        patience = STUCK_AFTER + 3.0 * self.runner.scan_period / self.runner.speed
        return self._clock.monotonic() - self._turn > patience

    async def _poll(self) -> None:
        """Scan at every deadline; a deadline that passed during the scan before is skipped."""
        runner, clock = self.runner, self._clock
        period = runner.scan_period
        beat = period / runner.speed
        # A device that takes over from another in the middle goes on with its plant time.
        slot = max(0, math.ceil((clock.monotonic() - self.begin) / beat))
        while not await wait_for(self._ending, self.begin + slot * beat - clock.monotonic()):
            self._turn = clock.monotonic()
            try:
                await runner.poll(slot * period, self.begin + slot * beat)
            except Exception as error:  # noqa: BLE001  (told; the other devices go on)
                runner.note_defect(error, slot * period)
            reached = math.floor((clock.monotonic() - self.begin) / beat)
            following = max(slot + 1, reached)
            runner.late += following - slot - 1
            slot = following

    async def _service(self) -> None:
        """Let the write-backs look on a beat of their own, whatever the polling period."""
        clock, speed = self._clock, self.runner.speed
        # Twice a heartbeat: a look that comes a little early waits for half a beat, not a whole.
        beat = 0.5 * HEARTBEAT_EVERY / speed
        turn = max(0, math.ceil((clock.monotonic() - self.begin) / beat))
        while not await wait_for(self._ending, self.begin + turn * beat - clock.monotonic()):
            await self.runner.service((clock.monotonic() - self.begin) * speed)
            turn = max(turn + 1, math.floor((clock.monotonic() - self.begin) / beat))


def spawn(work: Coroutine[object, object, None], name: str) -> asyncio.Task[None]:
    """Start a task with a name."""
    return asyncio.create_task(work, name=name)


async def wait_for(event: asyncio.Event, seconds: float) -> bool:
    """Wait for an event for at most so many seconds; return whether it is set."""
    try:
        async with asyncio.timeout(max(0.0, seconds)):
            await event.wait()
    except TimeoutError:
        # It may have been set in the very turn in which the time was over.
        return event.is_set()
    return True


async def wait_for_end(
    stop: asyncio.Event | None, duration: float | None, failures: Sequence[asyncio.Future[None]]
) -> None:
    """Wait for ``stop`` or so many seconds; raise when something ended that must not."""
    asked = spawn(_wait_for_stop(stop), "stop")
    try:
        done, _ = await asyncio.wait(
            [asked, *failures], timeout=duration, return_when=asyncio.FIRST_COMPLETED
        )
        for future in done:
            future.result()
    finally:
        asked.cancel()


async def _wait_for_stop(stop: asyncio.Event | None) -> None:
    await (stop or asyncio.Event()).wait()
