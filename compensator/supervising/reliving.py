"""A new compensator relives the recent scans, a few in each new one.

It knows stem, load and noise at once, as if it had followed the loop all along; but to go through
300 scans in one would take longer than a scan lasts.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from compensator.action import Controller
from compensator.supervising.figures import Sample

__all__ = ["Reliving"]


class Reliving:
    """The scans that a compensator has yet to observe; `observe` once a scan.

    Args:
        share: scans that it observes in one.
    """

    def __init__(self, share: int) -> None:
        self._share = share
        self._ahead: deque[Sample] = deque()

    @property
    def done(self) -> bool:
        """Whether the compensator has observed all there was."""
        return not self._ahead

    def begin(self, samples: Iterable[Sample]) -> None:
        """Take what a new compensator has to observe, oldest first."""
        self._ahead = deque(samples)

    def forget(self) -> None:
        """Drop what is left: the compensator is gone."""
        self._ahead.clear()

    def observe(self, compensator: Controller, sample: Sample) -> None:
        """Take in the sample of this scan, and let the compensator observe its next share."""
        self._ahead.append(sample)
        for _ in range(min(self._share, len(self._ahead))):
            past = self._ahead.popleft()
            compensator.observe(past.pv, past.op)
