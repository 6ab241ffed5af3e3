"""What every kind of link offers: scans of a device's tags, and registers to write back through.

A scan never fails as a whole: what could not be read is a `Reading` whose quality says why, and
the errors behind it are listed once. So one bad register costs no other tag its value, and a caller
of a scan has a single path.

    link = open_link(site, "plc", clock)
    await link.open()
    scan = await link.scan()
    scan["FC101.PV"].value        # NaN unless the quality is good
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple, Protocol, runtime_checkable

from fieldlink.links.errors import LinkError

__all__ = [
    "CountingLink",
    "Link",
    "LinkState",
    "Quality",
    "Reading",
    "RegisterAccess",
    "Scan",
    "SteppedLink",
]


class Quality(Enum):
    """What a reading is worth; the value is the code that is stored."""

    GOOD = (0, "a value read in this scan")
    NOT_A_NUMBER = (1, "the register holds NaN or infinity: the PLC marks the signal as bad")
    BELOW_RANGE = (
        2,
        "below the map's low: check sensor, address, word order, scale, range",
    )
    ABOVE_RANGE = (
        3,
        "above the map's high: check sensor, address, word order, scale, range",
    )
    NOT_READ = (4, "the request failed: see the link's errors")
    QUARANTINED = (5, "the register answered with an exception and is left out for a while")
    INVALID = (7, "the register holds the value that the map declares to mean invalid")
    NOT_DUE = (8, "not asked for in this scan: its loop has a longer period than others")
    NO_COUNT = (9, "the cycle counter holds no count: check its type and its word order in the map")
    RESTARTED = (
        12,
        "the first count after the cycle counter started again: the controller's values may not be "
        "there yet; if every sample is of this kind, check the counter's type and word order",
    )
    LATE = (
        10,
        "polled or reported so late that the value belongs to another slot: look at the lateness "
        "metric",
    )
    BAD_STATUS = (11, "the server gives no good status with the value: look at its diagnostics")
    NO_SCALAR = (
        13,
        "the node holds a text, an array or nothing at all: name one that holds a single number",
    )
    UNKNOWN_TAG = (6, "the link has no such tag: check the register map")

    def __init__(self, code: int, advice: str) -> None:
        self.code = code
        self.advice = advice


class Reading(NamedTuple):
    """One tag in one scan.

    Attributes:
        value: in engineering units; NaN unless ``quality`` is good.
        quality: what the value is worth.
        monotonic: seconds of the link's clock when the reply arrived.
        utc: seconds since 1970 when the reply arrived.
        text: what a string holds; its ``value`` is NaN.
        status: name of the server's status code, where that is why the value is bad.
    """

    value: float
    quality: Quality
    monotonic: float
    utc: float
    text: str | None = None
    status: str = ""

    @property
    def good(self) -> bool:
        """Whether the value may enter a window."""
        return self.quality is Quality.GOOD

    @property
    def was_read(self) -> bool:
        """Whether the device gave something for it, good or bad."""
        return self.quality not in (Quality.NOT_READ, Quality.QUARANTINED, Quality.UNKNOWN_TAG)

    def age(self, now: float) -> float:
        """Return the seconds since the reply arrived, at ``now`` of the link's clock."""
        return now - self.monotonic


@dataclass(frozen=True, slots=True)
class Scan:
    """All mapped tags of a device, read once.

    Attributes:
        readings: tag to reading, one for every mapped tag.
        monotonic: seconds of the link's clock when the scan began.
        utc: seconds since 1970 when the scan began.
        requests: how many requests it took.
        failures: the errors behind the readings that are not good, each once.
        connected: whether a session had to be opened first, which is no usual delay.
    """

    readings: Mapping[str, Reading]
    monotonic: float
    utc: float
    requests: int = 0
    failures: tuple[LinkError, ...] = field(default=())
    connected: bool = False

    def __getitem__(self, tag: str) -> Reading:
        """Return the reading of ``tag``; one of quality ``UNKNOWN_TAG`` where there is none."""
        reading = self.readings.get(tag)
        if reading is None:
            return Reading(math.nan, Quality.UNKNOWN_TAG, self.monotonic, self.utc)
        return reading

    @property
    def answered(self) -> bool:
        """Whether any tag was read in this scan, well or badly, or none had to be."""
        asked = False
        for reading in self.readings.values():
            if reading.monotonic >= self.monotonic and reading.quality is not Quality.NOT_DUE:
                if reading.quality is not Quality.NOT_READ:
                    return True
                asked = True
        return not asked


class LinkState(Enum):
    """How a link is doing, with advice for the operator."""

    CLOSED = "not opened, or stopped"
    GOOD = "answering"
    DEGRADED = "answering, but not for every tag: see the quarantined tags and the last error"
    DEMOTED = "not answering; tried again after a growing pause: check power, cable and address"

    @property
    def advice(self) -> str:
        """What the state means for the operator."""
        return self.value


class Link(Protocol):
    """A source of scans."""

    @property
    def state(self) -> LinkState:
        """Whether the link works, in part or not at all."""
        ...

    async def open(self) -> None:
        """Make ready. A device that is absent is not an error here: `scan` keeps trying.

        Raises:
            LinkError: what waiting does not cure, such as a recording that is not there.
        """
        ...

    async def scan(self) -> Scan:
        """Read every mapped tag once; does not raise for what a device does or fails to do."""
        ...

    async def close(self) -> None:
        """Let go of the device; may be called twice."""
        ...


@runtime_checkable
class RegisterAccess(Protocol):
    """The holding registers of a device, for the write-back. Every method raises `LinkError`."""

    async def read_registers(self, address: int, count: int) -> list[int]:
        """Read ``count`` holding registers in one request (FC3)."""
        ...

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        """Write all ``words`` in one request (FC16); never repeated by the link itself."""
        ...

    async def write_register(self, address: int, word: int) -> None:
        """Write one register (FC6); never repeated by the link itself."""
        ...


@runtime_checkable
class SteppedLink(Link, Protocol):
    """A link whose plant moves only when it is scanned: a simulation or a recording."""

    @property
    def scan_period(self) -> float:
        """Plant seconds by which one scan advances the plant."""
        ...


@runtime_checkable
class GoesOn(Protocol):
    """A stepped link whose controller works on between two scans: it watches its registers."""

    def go_on(self, seconds: float) -> None:
        """Let the controller look at its registers ``seconds`` of plant time after a scan."""
        ...


@runtime_checkable
class CountingLink(Link, Protocol):
    """A link whose connection can be lost; it counts openings, late replies and refused tags."""

    @property
    def connects(self) -> int:
        """How often the connection was opened."""
        ...

    @property
    def late_replies(self) -> int:
        """Replies that came after their time-out and were recognised and passed over."""
        ...

    @property
    def quarantined(self) -> tuple[str, ...]:
        """The tags that are left out for now because the device refuses their registers."""
        ...
