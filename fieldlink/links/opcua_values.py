"""What an OPC UA server says about a value: its status code, in words and with advice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from asyncua import ua

__all__ = ["NOT_THERE", "NodeValue", "help_for", "node_value", "status_of"]

_HELP = {
    "BadNodeIdUnknown": "check the node id, and that the server has loaded its project",
    "BadNodeIdInvalid": "check the node id",
    "BadUserAccessDenied": "give the user the right to it",
    "BadNotReadable": "give the user the right to read it",
    "BadNotWritable": "give the user the right to write it",
    "BadWriteNotSupported": "this server cannot write a part of an array",
    "BadIndexRangeInvalid": "the array is too short or the server does not support index ranges",
    "BadIndexRangeNoData": "the array is too short for the exchange area: lengthen it",
    "BadTypeMismatch": "make exchange_node an array of UInt16",
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


@dataclass(frozen=True, slots=True)
class NodeValue:
    """What the server says about a node.

    Attributes:
        value: as it came; None with a bad status.
        status: name of the status code.
        good: whether the status is good.
        refused: whether the node cannot be read at all.
    """

    value: Any
    status: str
    good: bool
    refused: bool


def node_value(data: Any) -> NodeValue:
    """Return what a DataValue of asyncua says."""
    status = data.StatusCode or ua.StatusCode(ua.StatusCodes.Good)
    name = str(status.name)
    value = None if data.Value is None else data.Value.Value
    return NodeValue(value, name, bool(status.is_good()), name in NOT_THERE)


def help_for(status: str) -> str:
    """Return what to do about a status code."""
    return _HELP.get(status, "look at the server's diagnostics")


def status_of(error: Exception) -> str:
    """Return the name of the status code behind an error, in one line."""
    code = getattr(error, "code", None)
    if code is None:
        return " ".join(str(error).split()) or "the server's answer makes no sense"
    return str(ua.StatusCode(code).name)
