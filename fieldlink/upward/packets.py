"""Messages to and from a broker."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Incoming", "Outgoing"]


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message to the broker."""

    topic: str
    payload: bytes
    qos: int = 1
    retain: bool = False


@dataclass(frozen=True, slots=True)
class Incoming:
    """A message from the broker."""

    topic: str
    payload: bytes
    retained: bool
