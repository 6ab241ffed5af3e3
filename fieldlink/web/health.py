"""Whether the daemon lives and whether it is of use, from a snapshot of it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from fieldlink.daemon import DaemonStatus
from fieldlink.links import LinkState

__all__ = ["Readiness"]

MOST_TAGS = 10
"""Tags that are named of those that a device refuses."""

_ANSWERING = (LinkState.GOOD, LinkState.DEGRADED)


@dataclass(frozen=True, slots=True)
class Readiness:
    """Whether the daemon does its work, with what keeps it from that or restricts it.

    Attributes:
        ready: some device answers and what is read can be stored.
        reasons: everything that is not as it should be, whether or not it makes ``ready`` false.
        devices: number of devices by state.
    """

    ready: bool
    reasons: tuple[str, ...]
    devices: dict[str, int]

    @classmethod
    def of(cls, status: DaemonStatus, *, started: bool) -> Readiness:
        """Judge a snapshot."""
        reasons: list[str] = []
        if not started:
            reasons.append("the daemon is starting")
        if status.store.failing:
            reasons.append(f"the store cannot be written: {status.store.last_error}")
        answering = 0
        for name, device in status.devices.items():
            if device.state in _ANSWERING:
                answering += 1
            if device.state is not LinkState.GOOD:
                said = device.last_failure.removeprefix(f"device {name}: ")
                said = said or device.state.advice
                reasons.append(f"device {name} is {device.state.name.lower()}: {said}")
            if device.quarantined:
                tags = ", ".join(device.quarantined[:MOST_TAGS])
                more = len(device.quarantined) - MOST_TAGS
                reasons.append(
                    f"device {name} refuses {tags}" + (f" and {more} more" if more > 0 else "")
                )
        states = Counter(device.state.name.lower() for device in status.devices.values())
        ready = started and answering > 0 and not status.store.failing
        return cls(ready, tuple(reasons), dict(states))

    def to_dict(self) -> dict[str, Any]:
        """Return what ``/readyz`` answers."""
        return {"ready": self.ready, "reasons": list(self.reasons), "devices": self.devices}
