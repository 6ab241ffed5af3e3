"""What to do about answers that do not fit: a habit of the device, or something between."""

from __future__ import annotations

from fieldlink.links.wire import WrongReplyError

__all__ = ["Misfits"]

_BETWEEN = "look for a second master or a faulty gateway"


class Misfits:
    """Remembers whether a device has ever answered as it was asked, and how it answers else."""

    def __init__(self) -> None:
        self._has_fitted = False
        self._seen: set[tuple[int | None, int | None]] = set()

    def note_fit(self) -> None:
        """Note an answer that fits: one that never fits is a habit of the device."""
        self._has_fitted = True

    def remedy(self, error: WrongReplyError) -> str:
        """Return what to do about an answer that does not fit."""
        self._seen.add((error.unit, error.transaction))
        is_habit = not self._has_fitted and len(self._seen) == 1
        if is_habit and error.unit is not None:
            return (
                f"set unit = {error.unit} if all its answers are so: the device has that number, "
                f"or answers to any; else {_BETWEEN}"
            )
        if error.transaction == 0:
            return (
                "transaction id 0 is in its answer instead of the request's: ask its maker for a "
                "firmware that repeats the id, or use its serial framing over TCP "
                '(link = "modbus-rtu-tcp") if it has that'
            )
        return f"the connection is opened again; if it persists, {_BETWEEN}"
