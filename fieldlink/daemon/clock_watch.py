"""A wall clock that steps: noticed within a second by comparing it with the monotonic clock.

Sampling goes by the monotonic clock and does not care. What does care is told: the samples' time
stamps are marked from there on, and the scheduler's jobs are moved along.
"""

from __future__ import annotations

from fieldlink.links import Clock

__all__ = ["CHECK_EVERY", "ClockWatch"]

CHECK_EVERY = 1.0
"""Seconds between two looks."""

SMALLEST_STEP = 2.0
"""Seconds: less than this between two looks is a clock that is being slewed."""


class ClockWatch:
    """Looks at a clock, now and then.

    Args:
        clock: the clock.

    Attributes:
        steps: steps seen so far.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset = clock.utc() - clock.monotonic()
        self.steps = 0

    def look(self) -> float:
        """Return by how many seconds the wall clock has stepped since the last look; 0 if not.

        A machine that was suspended counts as a step forward: its monotonic clock stood still.
        """
        offset = self._clock.utc() - self._clock.monotonic()
        step, self._offset = offset - self._offset, offset
        if abs(step) < SMALLEST_STEP:
            return 0.0
        self.steps += 1
        return step
