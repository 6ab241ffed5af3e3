"""What can go wrong on the way upward."""

from __future__ import annotations

from fieldlink.errors import FieldlinkError

__all__ = ["BrokerError", "BrokerRefusalError", "BrokerVersionError", "UpwardError"]


class UpwardError(FieldlinkError):
    """Publishing cannot work: a package or a file is missing or unreadable."""


class BrokerError(FieldlinkError):
    """The broker does not answer, or the connection was lost; it is tried again."""


class BrokerRefusalError(BrokerError):
    """The broker refused a message, or closed the connection while messages were being sent."""


class BrokerVersionError(BrokerError):
    """The broker ended the connection at CONNECT: it may not speak this version of MQTT."""
