"""Tags that a device refuses: left out for a while, and asked for again after pauses that grow.

A register that does not exist costs one request in a minute. A device that refuses everything is
another matter: a PLC answers so while a program is loaded into it, and is asked again in seconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fieldlink.registers import ReadRequest, Tag

__all__ = ["Quarantine", "Trial"]

FIRST_PAUSE = 2.0
"""Seconds until a refused tag is asked for again the first time: longer than a disturbance of some
tenths of a second, short beside the window of any loop."""


@dataclass(frozen=True, slots=True)
class _Refused:
    tag: Tag
    pause: float
    until: float
    refusals: int


@dataclass(frozen=True, slots=True)
class Trial:
    """A tag to ask for, and the tags that stay refused if it is refused."""

    tag: Tag
    stands_for: tuple[Tag, ...]


class Quarantine:
    """The tags of one device that are left out.

    Args:
        plan: the requests of the device.
        longest: the longest pause in seconds.
    """

    def __init__(self, plan: Sequence[ReadRequest], longest: float) -> None:
        self._plan = tuple(plan)
        self._tags = sum(len(request.tags) for request in self._plan)
        self._longest = longest
        self._refused: dict[str, _Refused] = {}

    def __len__(self) -> int:
        return len(self._refused)

    def __contains__(self, name: str) -> bool:
        return name in self._refused

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the tags."""
        return tuple(self._refused)

    @property
    def is_whole_device(self) -> bool:
        """Whether every tag of the device is refused."""
        return len(self._refused) >= self._tags

    def refuse(self, tags: Iterable[Tag], now: float) -> None:
        """Leave tags out from ``now`` (monotonic seconds) on, each time for twice as long.

        While the whole device refuses, the pauses do not grow.
        """
        shortest = min(FIRST_PAUSE, self._longest)
        for tag in tags:
            before = self._refused.get(tag.name)
            refusals = 0 if before is None else before.refusals
            pause = shortest if before is None else min(2.0 * before.pause, self._longest)
            self._refused[tag.name] = _Refused(tag, pause, now + pause, refusals + 1)
        if self.is_whole_device:
            for name, entry in self._refused.items():
                until = min(entry.until, now + shortest)
                self._refused[name] = _Refused(entry.tag, shortest, until, entry.refusals)

    def clear(self) -> None:
        """Take every tag back: something that was refused has been answered."""
        self._refused.clear()

    def trials(self, now: float) -> list[Trial]:
        """Return the tags to ask for at ``now``.

        Where all tags of a request are refused, one is asked for, a different one each time.
        """
        found: list[Trial] = []
        if not self._refused:
            return found
        for request in self._plan:
            refused = [tag for tag in request.tags if tag.name in self._refused]
            due = tuple(tag for tag in refused if self._refused[tag.name].until <= now)
            if not due:
                continue
            if len(refused) == len(request.tags):
                number = self._refused[due[0].name].refusals - 1
                found.append(Trial(due[number % len(due)], due))
            else:
                found.extend(Trial(tag, (tag,)) for tag in due)
        return found
