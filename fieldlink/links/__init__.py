"""Links: one module per kind of source behind one small protocol.

A link knows tags and registers; what a tag means for a loop is not known here.
"""

from fieldlink.links.base import (
    CountingLink,
    GoesOn,
    Link,
    LinkState,
    Quality,
    Reading,
    RegisterAccess,
    Scan,
    SteppedLink,
)
from fieldlink.links.clock import Clock, SystemClock, VirtualClock
from fieldlink.links.errors import (
    AccessRefusedError,
    ExceptionCode,
    ExceptionReplyError,
    LinkError,
    LinkPausedError,
    LinkTimeoutError,
    LinkUnreachableError,
    PlantFailedError,
    RecordingEndedError,
    ReplyMismatchError,
    UnknownLinkKindError,
)
from fieldlink.links.registry import LinkFactory, link_kinds, open_link, register_link

__all__ = [
    "AccessRefusedError",
    "Clock",
    "CountingLink",
    "ExceptionCode",
    "ExceptionReplyError",
    "GoesOn",
    "Link",
    "LinkError",
    "LinkFactory",
    "LinkPausedError",
    "LinkState",
    "LinkTimeoutError",
    "LinkUnreachableError",
    "PlantFailedError",
    "Quality",
    "Reading",
    "RecordingEndedError",
    "RegisterAccess",
    "ReplyMismatchError",
    "Scan",
    "SteppedLink",
    "SystemClock",
    "UnknownLinkKindError",
    "VirtualClock",
    "link_kinds",
    "open_link",
    "register_link",
]
