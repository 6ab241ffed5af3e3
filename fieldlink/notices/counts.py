"""Counts of notices, for status, metrics and tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["NoticesReport", "ReceiverReport"]


@dataclass(frozen=True, slots=True)
class ReceiverReport:
    """One receiver.

    Attributes:
        delivered: notices that it took.
        failed: attempts that failed.
        given_up: notices that are tried no more.
        last_error: of the newest attempt that failed; empty before.
    """

    delivered: int = 0
    failed: int = 0
    given_up: int = 0
    last_error: str = ""


@dataclass(frozen=True, slots=True)
class NoticesReport:
    """All receivers by name, and how many notices wait for the hour to be over."""

    receivers: Mapping[str, ReceiverReport] = field(default_factory=dict)
    held: int = 0
