"""How often the writer shows that it lives, and when a reader calls it dead."""

from __future__ import annotations

__all__ = ["HEARTBEAT_EVERY", "HEARTBEAT_TIMEOUT"]

HEARTBEAT_EVERY = 2.0
"""Seconds from one heartbeat to the next, whatever the polling period: a reader may miss four."""

HEARTBEAT_TIMEOUT = 10.0
"""Seconds without a change after which a reader calls the heartbeat dead, unless set otherwise."""
