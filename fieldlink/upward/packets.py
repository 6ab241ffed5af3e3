"""Messages to and from a broker."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

__all__ = ["LONGEST_COMMAND", "LONGEST_TOPIC", "Incoming", "MqttVersion", "Outgoing", "TooLarge"]

LONGEST_COMMAND = 10_000
"""Bytes of a command that are read: a loop, a word and a reason take some hundred. Reading a longer
one would hold up the sampling, which shares the event loop."""


LONGEST_TOPIC = 0xFFFF
"""Bytes of a topic (MQTT 5, 1.5.4)."""


class MqttVersion(IntEnum):
    """Versions of MQTT, by the protocol level in CONNECT."""

    V3_1_1 = 4
    """Every broker speaks it; it acknowledges messages that its access rules make it drop."""
    V5 = 5
    """Its acknowledgements say what was refused."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message to the broker."""

    topic: str
    payload: bytes
    qos: int = 1
    retain: bool = False


@dataclass(frozen=True, slots=True)
class TooLarge:
    """A message that the broker does not take for its size.

    Attributes:
        size: its bytes on the wire, at most.
        limit: bytes that the broker takes; 0 where it did not say.
    """

    topic: str
    size: int
    limit: int


@dataclass(frozen=True, slots=True)
class Incoming:
    """A message from the broker.

    Attributes:
        payload: empty where the message is too long to be read.
        retained: whether the broker kept it from before our subscription.
        too_long: its size in bytes where that is above `LONGEST_COMMAND`, else 0.
    """

    topic: str
    payload: bytes
    retained: bool
    too_long: int = 0

    @classmethod
    def of(cls, topic: str, payload: bytes, *, retained: bool) -> Incoming:
        """Take a message in, without its payload where that is too long."""
        size = len(payload)
        if size > LONGEST_COMMAND:
            return cls(topic, b"", retained, size)
        return cls(topic, bytes(payload), retained)

    @property
    def refusal(self) -> str | None:
        """Why the message is not a command, whatever is in it; None where it may be one."""
        if self.retained:
            return (
                "a retained command would be carried out at every connection; publish it without "
                "the retain flag"
            )
        if self.too_long:
            return f"the message has {self.too_long} bytes; a command has at most {LONGEST_COMMAND}"
        return None
