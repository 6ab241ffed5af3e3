"""What a format has to know: how messages become packets, and what a session begins and ends with.

`json_format` and `sparkplug_format` are the two; `delivery` runs either over a connection.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from fieldlink.site import Site
from fieldlink.upward.messages import Message
from fieldlink.upward.packets import Incoming, Outgoing

__all__ = ["Format", "Health"]

Health = Mapping[str, object]
"""State of the site: ``devices`` (name, state, reason, missed), ``loops`` (state of its device by
loop), ``store_failing``."""


class Format(Protocol):
    """One kind of payload. Nothing here waits or raises for what a broker does."""

    @property
    def name(self) -> str:
        """Name in the site file."""
        ...

    @property
    def confirms(self) -> bool:
        """Whether its packets are acknowledged one by one (QoS 1)."""
        ...

    @property
    def retained(self) -> Sequence[str]:
        """Topics of the site on which the broker keeps what this format sends."""
        ...

    def follow(self, site: Site, stream: str) -> None:
        """Take a site's loops and names; ``stream`` names the spool's numbering."""
        ...

    def note(self, message: Message) -> None:
        """Take note of a message that was spooled, in the order of numbers."""
        ...

    def will(self, birth: int) -> Outgoing:
        """Return the will of session number ``birth``."""
        ...

    def subscriptions(self) -> Sequence[str]:
        """Return the filters to subscribe to before anything is sent."""
        ...

    def begin(self, health: Health) -> Iterable[Outgoing]:
        """Return what a session begins with."""
        ...

    def repeats(self, before: int) -> Iterable[Outgoing]:
        """Return what the broker is to keep and may have forgotten, of messages below ``before``.

        Such a message was delivered, or dropped undelivered.
        """
        ...

    def forget_repeats(self) -> None:
        """Repeat nothing that was noted up to now: the broker takes it no more."""
        ...

    def encode(self, message: Message) -> Iterable[Outgoing]:
        """Return a message's packets."""
        ...

    def note_health(self, health: Health) -> Iterable[Outgoing]:
        """Return what a change of health gives to send."""
        ...

    def receive(self, incoming: Incoming, health: Health) -> Iterable[Outgoing]:
        """Return the answer to a message from the broker; a look at the health follows."""
        ...

    def farewell(self) -> Sequence[Outgoing]:
        """Return what a session ends with when the daemon stops."""
        ...
