"""What can go wrong between the adapter and a device, each with what to do about it."""

from __future__ import annotations

from enum import Enum

from fieldlink.errors import FieldlinkError

__all__ = [
    "AccessRefusedError",
    "ExceptionCode",
    "ExceptionReplyError",
    "LinkError",
    "LinkPausedError",
    "LinkTimeoutError",
    "LinkUnreachableError",
    "PlantFailedError",
    "RecordingEndedError",
    "ReplyMismatchError",
    "UnknownLinkKindError",
]


class ExceptionCode(Enum):
    """The exception codes of the Modbus application protocol (V1.1b3, section 7), with advice."""

    ILLEGAL_FUNCTION = (1, "the device does not serve this table: check the map's table column")
    ILLEGAL_ADDRESS = (
        2,
        "a register does not exist or may not be read: check the map's addresses",
    )
    ILLEGAL_VALUE = (
        3,
        "the device refuses these registers, or so many in one request: check the map's addresses, "
        "and lower max_registers",
    )
    DEVICE_FAILURE = (4, "the device failed while answering: look at its own diagnostics")
    ACKNOWLEDGE = (
        5,
        "the device has taken the request without an answer to it: see its manual for registers "
        "that it answers at once",
    )
    DEVICE_BUSY = (6, "the device is busy: poll it less often")
    NEGATIVE_ACKNOWLEDGE = (7, "the device cannot do this: check the map")
    PARITY_ERROR = (8, "the device found its memory corrupt: have it serviced")
    GATEWAY_PATH = (10, "the gateway has no path to the unit: check the gateway's configuration")
    GATEWAY_TARGET = (11, "no unit of that id behind the gateway: check the unit id and its wiring")
    UNKNOWN = (0, "the device gave a code outside the standard: see its manual")

    def __init__(self, code: int, advice: str) -> None:
        self.code = code
        self.advice = advice

    @classmethod
    def of(cls, code: int) -> ExceptionCode:
        """Return the member of ``code``, or ``UNKNOWN``."""
        return next((member for member in cls if member.code == code), cls.UNKNOWN)

    @property
    def blames_an_address(self) -> bool:
        """Whether a smaller request to the same device may well succeed."""
        return self in _BLAMES_AN_ADDRESS

    @property
    def is_the_gateways(self) -> bool:
        """Whether a gateway answered for a unit that did not."""
        return self in (ExceptionCode.GATEWAY_PATH, ExceptionCode.GATEWAY_TARGET)


_OF_A_WRITE = {
    ExceptionCode.ILLEGAL_FUNCTION: (
        "the device does not know this function: see its manual for the ways to write it"
    ),
    ExceptionCode.ILLEGAL_ADDRESS: (
        "the register does not exist or cannot be written: check its address, and whether the "
        "device protects it"
    ),
    ExceptionCode.ILLEGAL_VALUE: (
        "the device refuses the value, or so many registers in one request: see its manual"
    ),
}
"""Advice on exceptions to a write, where that to a read would mislead."""

_BLAMES_AN_ADDRESS = frozenset(
    {ExceptionCode.ILLEGAL_ADDRESS, ExceptionCode.ILLEGAL_VALUE, ExceptionCode.DEVICE_FAILURE}
)


class LinkError(FieldlinkError):
    """A request to a device did not give what was asked for.

    Attributes:
        device: the device's name in the site file.
        remedy: what to do about it.
    """

    def __init__(self, device: str, what: str, remedy: str) -> None:
        # A host has no name but its address, which the message gives already.
        named = any(mark in device for mark in ".:/") and device in what
        super().__init__(f"{what}; {remedy}" if named else f"device {device}: {what}; {remedy}")
        self.device = device
        self.what = what
        self.remedy = remedy


class LinkUnreachableError(LinkError):
    """No connection: refused, lost, or waiting before the next attempt."""


class LinkPausedError(LinkUnreachableError):
    """Nothing was sent: the pause after a failure before is not over."""


class LinkTimeoutError(LinkError):
    """No reply in time. Whether a write was carried out is not known."""


class ReplyMismatchError(LinkError):
    """A reply that does not belong to the request: wrong transaction, unit, length or echo."""


class ExceptionReplyError(LinkError):
    """The device answered with an exception code.

    Attributes:
        code: what it means.
        number: the code as it came.
        request: what was asked for.
    """

    def __init__(
        self,
        device: str,
        request: str,
        code: int,
        *,
        is_write: bool = False,
        advice: str | None = None,
    ) -> None:
        self.code = ExceptionCode.of(code)
        self.number = code
        self.request = request
        if advice is None:
            advice = self.code.advice
            if is_write:
                advice = _OF_A_WRITE.get(self.code, advice)
        super().__init__(
            device, f"{request} answered with exception {code} ({self.code.name})", advice
        )


class AccessRefusedError(LinkError):
    """The adapter itself refuses the request: the site file does not allow it."""


class RecordingEndedError(LinkError):
    """A recording has no more rows."""


class PlantFailedError(LinkError):
    """A simulated plant has failed: its loop stands still from now on, the others go on."""


class UnknownLinkKindError(LinkError):
    """The site file names a kind of link that nothing has registered."""

    may_pass = False
