"""What the differences between a bank as written and as read say about the device."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["describe_differences"]


def describe_differences(
    written: Sequence[int], read: Sequence[int], before: Sequence[int] | None = None
) -> str:
    """Say how the registers of a bank differ from what was written, and what does that.

    Args:
        written: the registers as written.
        read: the registers as read afterwards, as many.
        before: as they were before the write; None when that is not known.

    Returns:
        Words; empty when nothing differs.
    """
    pairs = [(i, a, b) for i, (a, b) in enumerate(zip(written, read, strict=True)) if a != b]
    if not pairs:
        return ""
    offset, sent, found = pairs[0]
    words = (
        f"{len(pairs)} registers differ, the first at offset {offset}, which holds {found:#06x} "
        f"instead of {sent:#06x}"
    )
    known = _cause(pairs, before is not None and tuple(read) == tuple(before))
    return f"{words}; {known}" if known else words


def _cause(pairs: Sequence[tuple[int, int, int]], is_as_before: bool) -> str:
    """Name what makes all the differences at once; empty when nothing known does."""
    if is_as_before:
        return (
            "the whole bank is as before, so the device confirms the write and drops it: look for "
            "a write protection of these registers, and for a program that restores them"
        )
    if all(found == (sent >> 8 | (sent & 0xFF) << 8) for _, sent, found in pairs):
        return (
            "the two bytes of each register are exchanged: end that in the PLC or the gateway "
            "before it, because the byte order of a block is fixed"
        )
    limit = pairs[0][2]
    if len(pairs) > 1 and all(found == limit < sent for _, sent, found in pairs):
        return (
            f"no register keeps more than {limit}: give the bank registers of 16 bits without "
            "sign and without limits"
        )
    return ""
