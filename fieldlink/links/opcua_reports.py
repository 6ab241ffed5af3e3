"""How new the values are that an OPC UA server has reported: by its time stamps, and by ours.

A server samples a node, and publishes what has changed in messages; a message without a change is a
sign of life. After each message, every value is known to be at most one sampling interval older
than the message. Three things may make it older, and each has its time stamps:

- the message was long under way: it comes later than usual after its own stamp;
- the server stood still: its stamp is far from that of the message before, and what it says may
  have been sampled before the pause; only the next message tells;
- a value waited in the server: it comes later than usual after the value's stamp.

Some servers say nothing when a node goes, or comes again with a project that is loaded: they keep
the subscription alive and report that node no more. So nodes are read now and then as well, and one
that reads as another value and is not reported for that is watched by nobody.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from asyncua import ua

from fieldlink.links.opcua_values import NodeValue, node_value, second_of, stamp_of
from fieldlink.links.usual_delay import UsualDelay

__all__ = ["SHARE", "Reports"]

SHARE = 0.25
"""Share of a period: asked for as sampling and as publishing interval, and granted to a message for
its way. So a good value is of the last three quarters of a period, and two values in a row are of
two moments."""


class Reports:
    """What a subscription has reported.

    Args:
        period: seconds from one scan to the next.

    Attributes:
        sampling: seconds between two samples of a node, by the server.
        publishing: seconds between two messages, or signs of life.
        ended: the status with which the server has ended the subscription.
    """

    def __init__(self, period: float) -> None:
        self._spare = SHARE * period
        self.sampling = self.publishing = SHARE * period
        self.ended = ""
        self._heard: float | None = None
        self._node_of: dict[int, str] = {}
        self._values: dict[str, NodeValue] = {}
        self._stamps: dict[str, float] = {}
        self._late: set[str] = set()
        self._doubted: dict[str, int] = {}
        self._ways, self._waits = UsualDelay(), UsualDelay()
        self._sent: float | None = None
        self._stood_still = False
        self._known_at: float | None = None

    @property
    def limit(self) -> float:
        """The age in seconds up to which a value is good."""
        return self.sampling + self.publishing + self._spare

    def grant_publishing(self, granted: Any) -> None:
        """Take the intervals that the server has made of those asked for; longer ones count."""
        rounds = max(1, int(granted.RevisedMaxKeepAliveCount))
        seconds = 0.001 * float(granted.RevisedPublishingInterval)
        self.publishing = max(self.publishing, rounds * seconds)

    def grant_sampling(self, milliseconds: float) -> None:
        """Take the interval at which the server samples a node; the longest of all counts."""
        self.sampling = max(self.sampling, 0.001 * float(milliseconds))

    def silence(self, now: float) -> float:
        """Return the seconds since the last message; 0 before the first."""
        return 0.0 if self._heard is None else now - self._heard

    def expect(self, handle: int, node: str) -> None:
        """Take a node's reports from now on; ``handle`` is the number they carry."""
        self._node_of[handle] = node

    def refuse(self, node: str, status: str, *, refused: bool) -> None:
        """Note that the server does not report a node."""
        self._values[node] = NodeValue(None, status, good=False, refused=refused)

    def has(self, node: str) -> bool:
        """Whether something is known of a node."""
        return node in self._values

    def latest(self, node: str) -> NodeValue | None:
        """Return the newest value of a node; None before the first."""
        found = self._values.get(node)
        return found if found is None or node not in self._late else replace(found, late=True)

    def compare(self, node: str, read: NodeValue) -> None:
        """Take note of what a node reads as; a report of it is due when that is another value."""
        known = self._values.get(node)
        if known is None or not (known.good or known.refused):
            return
        if known.good == read.good and (not read.good or _is_same(known.value, read.value)):
            self._doubted.pop(node, None)
        else:
            self._doubted[node] = self._doubted.get(node, 0) + 1

    @property
    def doubted(self) -> tuple[str, ...]:
        """The nodes that a report is due of."""
        return tuple(self._doubted)

    @property
    def unwatched(self) -> str:
        """A node that was read as another value twice without a report; empty without one."""
        return next((node for node, reads in self._doubted.items() if reads > 1), "")

    def age(self, now: float) -> float | None:
        """Return by how much the values may be older than ``now``; None before the first."""
        return None if self._known_at is None else now - self._known_at

    def take(self, result: Any, arrived: float) -> None:
        """Take a message of the server.

        Args:
            result: asyncua's PublishResult.
            arrived: seconds of our clock.
        """
        message = result.NotificationMessage
        for part in message.NotificationData or ():
            if isinstance(part, ua.StatusChangeNotification):
                self.ended = str(part.Status.name)
                return
        delay = self._note_message(second_of(message.PublishTime), arrived)
        self._late.clear()
        wait: float | None = None
        for part in message.NotificationData or ():
            if isinstance(part, ua.DataChangeNotification):
                for item in part.MonitoredItems:
                    wait = self._take_value(item, arrived, wait)
        if result.MoreNotifications:
            # The rest of what was sampled is still to come.
            return
        if not self._stood_still:
            self._known_at = arrived - delay - self.sampling
        self._stood_still = False

    def _note_message(self, sent: float | None, arrived: float) -> float:
        """Note when a message was sent; return how much later than usual it has come.

        A server whose clock stands, or is set back, tells nothing by it.
        """
        pause = 0.0 if self._heard is None else arrived - self._heard
        delay = 0.0
        if sent is not None and (self._sent is None or sent > self._sent):
            delay = max(0.0, self._ways.exceed(arrived - sent))
            if self._sent is not None:
                pause = sent - self._sent
        self._stood_still = self._stood_still or pause > self.publishing + self._spare
        self._heard, self._sent = arrived, sent
        return delay

    def _take_value(self, item: Any, arrived: float, usual: float | None) -> float | None:
        """Take a value; return the usual delay of values, once a message has told it.

        Only stamps that advance tell a delay. The first of a node may be of any age, since many
        servers stamp a value when it changes.
        """
        node = self._node_of.get(item.ClientHandle)
        if node is None:
            return usual
        self._values[node] = node_value(item.Value)
        self._doubted.pop(node, None)
        stamp, before = stamp_of(item.Value), self._stamps.get(node)
        if stamp is None:
            self._stamps.pop(node, None)
            return usual
        self._stamps[node] = stamp
        if before is None or stamp <= before:
            return usual
        delay = arrived - stamp
        if usual is None:
            usual = delay - self._waits.exceed(delay)
        if delay - usual > self.publishing + self._spare:
            self._late.add(node)
        return usual


def _is_same(one: Any, other: Any) -> bool:
    """Whether two values are one; NaN is NaN."""
    return bool(one == other or (one != one and other != other))
