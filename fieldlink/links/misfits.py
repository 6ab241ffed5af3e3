"""What to do about silence and answers that do not fit: a habit of the device, or a fault between.

Devices differ in how many registers they give in one request, and few say so by an exception.
"""

from __future__ import annotations

from fieldlink.links.frames import Request
from fieldlink.links.wire import WrongReplyError

__all__ = ["Misfits"]

_BETWEEN = "look for a second master or a faulty gateway"


class Misfits:
    """Remembers whether a device has ever answered as it was asked, and how it answers else.

    Args:
        on_serial_line: whether the settings of a line may be why it is silent.
    """

    def __init__(self, *, on_serial_line: bool) -> None:
        self._on_serial_line = on_serial_line
        self._longest = 0
        self._has_fitted = False
        self._seen: set[tuple[int | None, int | None]] = set()

    def note_fit(self, request: Request, pdu: bytes) -> None:
        """Note an answer that fits: one that never fits is a habit of the device."""
        self._has_fitted = True
        if request.count > self._longest and request.registers_of(pdu):
            self._longest = request.count

    def remedy(self, error: WrongReplyError) -> str:
        """Return what to do about an answer that does not fit."""
        self._seen.add((error.unit, error.transaction))
        is_habit = not self._has_fitted and len(self._seen) == 1
        if error.registers is not None and error.registers >= self._longest:
            return (
                f"set max_registers = {error.registers} if its answers to long requests are always "
                f"so; else {_BETWEEN}"
            )
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

    def remedy_of_silence(self, request: Request | None) -> str:
        """Return what to do about silence; ``request`` is None where the plan has none like it."""
        usual = "check the unit id, or raise the device's timeout"
        if self._on_serial_line and not self._has_fitted:
            usual = (
                "check the unit id, the line's baud rate, parity and stop bits, and its two wires, "
                "which may be exchanged; or raise the device's timeout"
            )
        if request is None or not request.is_read or request.table.is_bits or request.count == 1:
            return usual
        if not self._has_fitted:
            return f"{usual}; if it answers shorter requests, lower max_registers"
        if request.count > self._longest > 0:
            return (
                f"raise the device's timeout, or lower max_registers: it has answered up to "
                f"{self._longest} registers, and never {request.count}"
            )
        return usual
