"""How often a device is polled, and which of its loops each poll serves."""

from __future__ import annotations

import math
from collections.abc import Iterable

from fieldlink.site.models import Loop

__all__ = ["poll_period", "polls_by_tag"]


def poll_period(loops: Iterable[Loop]) -> float:
    """Return the plant seconds between two polls that serve every loop of a device.

    A loop with a cycle counter is polled twice a period, so that no cycle is missed; the others
    once. The result divides all of these where that costs at most four times the fastest loop's
    polls.
    """
    wanted = [_wanted(loop) for loop in loops]
    if not wanted:
        return 1.0
    common = math.gcd(*(max(1, round(seconds * 1e6)) for seconds in wanted)) / 1e6
    fastest = min(wanted)
    return common if common >= 0.25 * fastest else 0.5 * fastest


def polls_by_tag(loops: Iterable[Loop]) -> dict[str, int]:
    """Return in every how many polls a tag of a loop has to be read.

    The tags of a loop are of one moment, so loops that share a tag are read as often as the fastest
    of them. A period that is not a multiple of the polls' is read in all of them.
    """
    every = list(loops)
    beat = poll_period(every)
    found: dict[str, int] = {}
    for loop in every:
        ratio = _wanted(loop) / beat
        polls = round(ratio) if abs(ratio - round(ratio)) < 1e-6 * ratio else 1
        found.update({tag: min(polls, found.get(tag, polls)) for tag in loop.tags})
    _level(every, found)
    return found


def _level(loops: list[Loop], polls: dict[str, int]) -> None:
    """Give all tags of a loop the polls of the most frequent, until no loop changes another's."""
    changed = True
    while changed:
        changed = False
        for loop in loops:
            least = min(polls[tag] for tag in loop.tags)
            for tag in loop.tags:
                if polls[tag] != least:
                    polls[tag], changed = least, True


def _wanted(loop: Loop) -> float:
    return loop.period / 2.0 if loop.scan is not None else loop.period
