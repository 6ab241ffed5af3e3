"""The events that the daemon's journal can hold in a rehearsal, by name."""

from __future__ import annotations

__all__ = ["EVENT_NAMES"]

_FAMILIES = {
    "daemon": ("start", "stop", "failed", "unfinished"),
    "device": ("good", "degraded", "demoted"),
    "lockstep": ("start",),
    "loop": ("silent", "sampled", "wrong_period", "right_period"),
    "writeback": (
        "unreachable",
        "reachable",
        "past_unknown",
        "lost",
        "heartbeat_lost",
        "refused",
        "contested",
        "uncontested",
        "disagrees",
        "experiment_wanted",
        "withdrawal_asked",
    ),
}

EVENT_NAMES = tuple(
    f"{family}.{name}" for family, names in _FAMILIES.items() for name in (*names, "flapping")
)
"""An expectation of another name could never be met, or never fail."""
