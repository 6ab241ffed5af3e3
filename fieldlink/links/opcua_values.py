"""What an OPC UA server says about a value: its status code, in words and with advice."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from asyncua import ua

__all__ = [
    "NOT_THERE",
    "UNREADABLE",
    "NodeValue",
    "help_for",
    "index_range",
    "node_value",
    "not_there",
    "second_of",
    "stamp_of",
    "status_of",
    "status_of_words",
    "uri_of",
]

_HELP = {
    "BadCertificateTimeInvalid": "renew our certificate (opcua.cert), or check the clocks of both "
    "machines",
    "BadCertificateUriInvalid": "make application_uri the URI that our certificate "
    "(opcua.cert) names",
    "BadCertificateUntrusted": "let the server trust our certificate (opcua.cert)",
    "BadSecurityChecksFailed": "let the server trust our certificate (opcua.cert); see its log",
    "BadSecurityPolicyRejected": "choose a security policy that the server offers",
    "BadIdentityTokenRejected": "check username and password_file",
    "BadIdentityTokenInvalid": "check username and password_file",
    "BadNodeIdUnknown": "check the node id, and that the server has loaded its project",
    "BadNodeIdInvalid": "check the node id",
    "BadUserAccessDenied": "check username and password_file, or give the user the right to it",
    "BadNotReadable": "give the user the right to read it",
    "BadNotWritable": "give the user the right to write it",
    "BadWriteNotSupported": "this server cannot write a part of an array",
    "BadIndexRangeInvalid": "the array is too short or the server does not support index ranges",
    "BadIndexRangeNoData": "the array is too short for the exchange area: lengthen it",
    "BadTypeMismatch": "make exchange_node an array of UInt16",
    "BadTooManyOperations": "the server takes fewer nodes in one request: lower max_nodes in the "
    "device's table opcua",
}
NOT_THERE = frozenset(
    {
        "BadNodeIdUnknown",
        "BadNodeIdInvalid",
        "BadAttributeIdInvalid",
        "BadNotReadable",
        "BadUserAccessDenied",
    }
)
"""Status codes that say that a node cannot be read, now or later, not that its value is bad."""

UNREADABLE = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    AssertionError,
    struct.error,
)
"""What asyncua raises, beside its own errors, over an answer that it cannot take apart."""

_NO_STAMP_YEARS = (1970, 3000)
"""Time stamps up to the one and from the other year are none: OPC UA's times begin in 1601."""


@dataclass(frozen=True, slots=True)
class NodeValue:
    """What the server says about a node.

    Attributes:
        value: as it came; None with a bad status.
        status: name of the status code.
        good: whether the status is good.
        refused: whether the node cannot be read at all.
        late: whether it was reported so late that it is a value of a period ago.
    """

    value: Any
    status: str
    good: bool
    refused: bool
    late: bool = False


def stamp_of(data: Any) -> float | None:
    """Return the seconds at which the server took a value, by its own clock; None if it tells none.

    Some servers fill the server's time with the first or the last moment that it can hold: then the
    source's time counts.
    """
    server = second_of(data.ServerTimestamp)
    return second_of(data.SourceTimestamp) if server is None else server


def second_of(stamp: datetime | None) -> float | None:
    """Return a time stamp of OPC UA in seconds since 1970; None where it holds none."""
    if stamp is None or not _NO_STAMP_YEARS[0] < stamp.year < _NO_STAMP_YEARS[1]:
        return None
    return stamp.replace(tzinfo=UTC).timestamp()


def node_value(data: Any) -> NodeValue:
    """Return what a DataValue of asyncua says."""
    status = data.StatusCode or ua.StatusCode(ua.StatusCodes.Good)
    name = str(status.name)
    value = None if data.Value is None else data.Value.Value
    return NodeValue(value, name, bool(status.is_good()), name in NOT_THERE)


def uri_of(node: str) -> str:
    """Return the namespace of a node id such as ``nsu=urn:plc;s=FC101.PV``."""
    return node.removeprefix("nsu=").partition(";")[0]


def not_there(node: str) -> NodeValue:
    """Return what is known of a node whose namespace the server has not."""
    status = f"BadNodeIdUnknown, because the server has no namespace {uri_of(node)}"
    return NodeValue(None, status, good=False, refused=True)


def help_for(status: str, otherwise: str = "look at the server's diagnostics") -> str:
    """Return what to do about a status code; ``otherwise`` where nothing special is known."""
    return _HELP.get(status, otherwise)


def status_of(error: Exception) -> str:
    """Return the name of the status code behind an error, in one line."""
    code = getattr(error, "code", None)
    if code is None:
        return " ".join(str(error).split()) or "the server's answer makes no sense"
    return str(ua.StatusCode(code).name)


def status_of_words(value: NodeValue, count: int) -> str:
    """The status code that names what is wrong with a part of an array; empty when it is whole."""
    if not value.good:
        return value.status
    words = value.value if isinstance(value.value, list) else []
    if len(words) != count:
        # A range beyond the array is answered with what there is of it; more comes from a server
        # that knows no ranges.
        return "BadIndexRangeNoData" if len(words) < count else "BadIndexRangeInvalid"
    is_sound = all(type(word) is int and 0 <= word <= 0xFFFF for word in words)
    return "" if is_sound else "BadTypeMismatch"


def index_range(first: int, count: int) -> str:
    """Return how a request names a part of an array."""
    return str(first) if count == 1 else f"{first}:{first + count - 1}"
