"""A wall clock that steps: noticed within a second by comparing it with the monotonic clock.

Sampling goes by the monotonic clock and is not affected. Stamps and jobs are: every sample is
marked with the stretch of time that its stamp belongs to, and the scheduler's jobs are moved along.
"""

from __future__ import annotations

import asyncio

from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.schedule import Schedule
from fieldlink.links import Clock

__all__ = ["ClockWatch", "follow_clock"]

CHECK_EVERY = 1.0
"""Seconds between two looks."""

SMALLEST_STEP = 2.0
"""Seconds: less than this between two looks is a clock that is being slewed."""


class ClockWatch:
    """Counts the stretches of time between steps of the wall clock.

    Args:
        clock: the clock.

    Attributes:
        steps: steps seen so far, which is also the number of the present stretch.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset = clock.utc() - clock.monotonic()
        self._before: float | None = None
        self._stepped = 0.0
        self.steps = 0

    def stretch_of(self, offset: float) -> int:
        """Return the stretch to which a time stamp belongs.

        Args:
            offset: the stamp's time of day less its monotonic time, in seconds. One that is unlike
                the present and the last stretch's begins a new one.
        """
        if abs(offset - self._offset) < SMALLEST_STEP:
            self._offset = offset
            return self.steps
        if self._before is not None and abs(offset - self._before) < SMALLEST_STEP:
            # Stamped before the step, and come late.
            return self.steps - 1
        self._begin(offset)
        return self.steps

    def look(self) -> float:
        """Return by how many seconds the wall clock has stepped since the last look; 0 if not.

        A machine that was suspended counts as a step forward: its monotonic clock stood still.
        """
        offset = self._clock.utc() - self._clock.monotonic()
        if abs(offset - self._offset) < SMALLEST_STEP:
            self._offset = offset
        else:
            self._begin(offset)
        stepped, self._stepped = self._stepped, 0.0
        return stepped

    def _begin(self, offset: float) -> None:
        self._stepped += offset - self._offset
        self._before, self._offset = self._offset, offset
        self.steps += 1


async def follow_clock(watch: ClockWatch, schedule: Schedule, journal: Journal) -> None:
    """Look every second, for ever: move the scheduler's jobs along with a step, and record it."""
    while True:
        await asyncio.sleep(CHECK_EVERY)
        journal.summarize()
        step = watch.look()
        if step == 0.0:
            continue
        schedule.clock_stepped(step)
        journal.event(
            "clock.stepped",
            "daemon",
            f"the wall clock stepped by {step:+.1f} s; sampling goes on, its samples are now "
            f"marked clock_steps = {watch.steps}",
            bad=True,
        )
