"""Counts of messages to the broker, for health, metrics and tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["FormatReport", "UpwardReport"]


@dataclass(frozen=True, slots=True)
class FormatReport:
    """One format's connection.

    Attributes:
        connected: whether the broker has accepted it.
        connects: times it did.
        delivered: messages that the broker has acknowledged.
        waiting: messages in the spool that it has not.
        skipped: messages that the broker does not take, or that no packet can carry.
        last_error: why the connection was lost last; empty before.
    """

    connected: bool = False
    connects: int = 0
    delivered: int = 0
    waiting: int = 0
    skipped: int = 0
    last_error: str = ""


@dataclass(frozen=True, slots=True)
class UpwardReport:
    """Everything that is published.

    Attributes:
        formats: by name, json and sparkplug.
        spooled: messages written to disk.
        dropped: messages lost to the bound, the age or a disk that could not be written.
        failing: whether the spool cannot be written now.
    """

    formats: Mapping[str, FormatReport] = field(default_factory=dict)
    spooled: int = 0
    dropped: int = 0
    failing: bool = False
