"""What stands before an FMU's own state in a snapshot: which moment it is, at which period."""

from __future__ import annotations

import struct

from .errors import PlantInputError

__all__ = ["pack_snapshot", "unpack_snapshot"]

_HEAD = struct.Struct("<4sqdd")
_MARK = b"FLP2"


def pack_snapshot(count: int, base: float, period: float, state: bytes) -> bytes:
    """Return a snapshot: ``count`` periods after ``base`` seconds, and the FMU's state."""
    return _HEAD.pack(_MARK, count, base, period) + state


def unpack_snapshot(model: str, period: float, snapshot: bytes) -> tuple[int, float, bytes]:
    """Return count of periods, base in seconds and the FMU's state.

    Args:
        model: name of the plant, for messages.
        period: of the plant, seconds.
        snapshot: bytes.

    Raises:
        PlantInputError: no snapshot, or one of another period.
    """
    head = snapshot[: _HEAD.size]
    if len(head) < _HEAD.size or head[:4] != _MARK:
        raise PlantInputError(f"plant {model}: these bytes are not a snapshot")
    _mark, count, base, taken_at = _HEAD.unpack(head)
    if taken_at != period:
        raise PlantInputError(
            f"plant {model}: the snapshot was taken at a period of {taken_at:g} s, the plant has "
            f"{period:g} s; open it with that period"
        )
    return count, base, snapshot[_HEAD.size :]
