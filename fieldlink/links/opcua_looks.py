"""When nodes that a server reports are read as well, to find those that it reports no more.

A new session cures a node that is gone or was made again. It does not cure a server that reports by
a dead band of its own, or whose source reads a little different from what it reports: there the
looks become seldom, so that no session is opened every few seconds for ever.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["LOOK_AGAIN", "LOOK_AT_LEAST", "Looks"]

LOOK_AGAIN = 10.0
"""Seconds from one look at reported nodes to the next: seldom beside the reports."""

LOOK_AT_LEAST = 3600.0
"""The longest such time, after sessions that have cured nothing."""


class Looks:
    """Knows when the next look is due, and at which nodes; it outlives sessions."""

    def __init__(self) -> None:
        self._pause = LOOK_AGAIN
        self._due = math.inf
        self._watched: tuple[str, ...] = ()
        self._alike = 0

    def begin(self, nodes: Sequence[str], now: float) -> None:
        """Note that a new session reports ``nodes``."""
        self._watched, self._due, self._alike = tuple(nodes), now + self._pause, 0

    def is_due(self, now: float) -> bool:
        """Whether nodes are to be looked at."""
        return now >= self._due

    def choose(self, doubted: Sequence[str], most: int) -> tuple[str, ...]:
        """Return the nodes to look at: at most ``most``, doubted ones before all in turns."""
        if doubted:
            return tuple(doubted[:most])
        nodes, rest = self._watched[:most], self._watched[most:]
        self._watched = (*rest, *nodes)
        return nodes

    def saw(self, count: int, now: float, *, again_after: float | None) -> None:
        """Note that ``count`` nodes were looked at.

        Args:
            count: number of nodes.
            now: the moment of our clock.
            again_after: seconds to the look that decides, where one was another than reported.
        """
        if again_after is not None:
            self._alike, self._due = 0, now + again_after
            return
        self._alike += count
        if self._alike >= len(self._watched):
            # Every node is as it was reported.
            self._pause, self._alike = LOOK_AGAIN, 0
        self._due = now + self._pause

    def note_new_session(self) -> bool:
        """Double the time between looks, as a session is opened for what they found.

        Returns:
            Whether it is the first one, and to be told: none before it failed to cure anything.
        """
        is_first = self._pause <= LOOK_AGAIN
        self._pause = min(2.0 * self._pause, LOOK_AT_LEAST)
        return is_first
