"""Which words of a device Fieldlink may write: its own parts of enabled exchange areas only."""

from __future__ import annotations

from fieldlink.site import Site

__all__ = ["WRITTEN_PARTS", "Ranges", "find_writable"]

WRITTEN_PARTS = frozenset({"heartbeat", "writer", "commit", "bank_a", "bank_b"})
"""The parts of an exchange area that are Fieldlink's to write; the others are the PLC's."""

Ranges = tuple[tuple[int, int], ...]


def find_writable(site: Site, device: str) -> Ranges:
    """Return the words (first, last) of a device that loops with enabled write-back may write."""
    layouts = [
        loop.writeback.exchange for loop in site.loops_of(device).values() if loop.writeback.enabled
    ]
    return tuple(
        (first, last)
        for layout in layouts
        if layout is not None
        for part, first, last in layout.spans()
        if part in WRITTEN_PARTS
    )
