"""Where a loop's samples come from now, and how many of them come."""

from __future__ import annotations

import time

from fieldlink.daemon import DaemonStatus, LoopStatus
from fieldlink.site import Site
from fieldlink.web.view.store_queries import Row

__all__ = ["device_of", "device_state_of", "quality_of"]

STALE_AFTER_MS = 600_000
"""A store whose newest sample is older than this is not being written."""


def device_of(name: str, site: Site | None, live: LoopStatus | None) -> str:
    """Return the name of a loop's device; empty when it is not known."""
    if live is not None:
        return live.device
    return site.loops[name].device if site is not None and name in site.loops else ""


def device_state_of(device: str, status: DaemonStatus | None, sample: Row | None) -> str:
    """Return the state of a device; without a daemon, whether samples still come."""
    if status is not None:
        found = status.devices.get(device)
        return "unknown" if found is None else found.state.name.lower()
    if sample is None:
        return "unknown"
    stale = time.time() * 1000.0 - sample["utc_ms"] > STALE_AFTER_MS
    return "silent" if stale else "recorded"


def quality_of(live: LoopStatus | None, slots: Row | None) -> float | None:
    """Share of the slots that were read with good values."""
    if live is not None:
        return round(live.counts.read / live.counts.expected, 3) if live.counts.expected else None
    if slots is None or not slots["expected"]:
        return None
    return float(slots["read"] / slots["expected"])
