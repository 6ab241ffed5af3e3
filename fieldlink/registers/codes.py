"""The codes that travel in a parameter block and in the PLC's acknowledgement."""

from __future__ import annotations

from enum import Enum, IntEnum

from fieldlink.errors import FieldlinkError

__all__ = [
    "ACCEPTED",
    "NOTHING_SEEN",
    "BlockError",
    "BlockFault",
    "Refusal",
    "Status",
    "Verdict",
    "describe_ack",
]

NOTHING_SEEN = 0
"""``ack_result`` of a PLC that has not judged any block."""

ACCEPTED = 1
"""``ack_result`` of an accepted block; every other code is a `BlockFault`."""


class Status(IntEnum):
    """What the block asks of its reader."""

    INVALID = 0
    VALID = 1
    NO_STICTION = 2
    NOT_ASSESSABLE = 3
    WITHDRAWN = 4


class Verdict(IntEnum):
    """The estimator's verdict on the window, as a code."""

    NONE = 0
    STICTION = 1
    NO_STICTION = 2
    NOT_ASSESSABLE = 3

    @classmethod
    def of(cls, name: str) -> Verdict:
        """Return the code of a verdict by its name, such as ``"no_stiction"``."""
        return cls[name.upper()]


class BlockFault(Enum):
    """Why registers are not accepted as a block; ``code`` is the PLC's ``ack_result``."""

    EMPTY = (2, "all registers are zero", "nothing was written yet, or the PLC cleared them")
    MAGIC = (3, "the first register is not 16#464C", "check the block's address and word order")
    VERSION = (4, "unknown layout version or length", "bring reader and writer to one release")
    CRC = (5, "the CRC does not match", "the write was torn or altered: write the block again")
    SEQ_TORN = (6, "the two sequence words differ", "the write was torn: write the block again")
    SEQ_ZERO = (7, "the sequence number is 0", "start sequence numbers at 1")
    NOT_NEWER = (8, "the sequence number is not newer", "continue from the acknowledged number")
    WRONG_LOOP = (9, "the block is for another loop", "check loop_id and the block's address")
    STATUS = (10, "the status is invalid or unknown", "send a status from 1 to 4")
    OUT_OF_RANGE = (
        11,
        "a value is outside its range",
        "compare the value with the reader's limits",
    )
    NOT_ENABLED = (12, "the enable register is 0", "let the operator enable the loop's block")
    COMMIT = (13, "the commit word names no bank", "write bank A (0) or B (1) in its high byte")

    def __init__(self, code: int, text: str, advice: str) -> None:
        self.code = code
        self.text = text
        self.advice = advice

    @classmethod
    def from_code(cls, code: int) -> BlockFault | None:
        """Return the fault that an ``ack_result`` stands for; None for 0, 1 and unknown codes."""
        return next((fault for fault in cls if fault.code == code), None)


class Refusal(Enum):
    """Why a consumer refuses or gave up a model; ``code`` is the PLC's ``ack_refusal``."""

    WRONG_SIGN = (
        20,
        "the gain has the wrong sign",
        "check the signs of OP and PV in the register map",
    )
    UNSTABLE = (21, "the process model is unstable", "identify again from a longer window")
    PERIOD = (22, "its sampling period is not the consumer's", "identify with the scan's period")
    RANGE = (
        23,
        "a parameter is outside what the controller accepts",
        "compare the block with the controller's limits",
    )
    WORSE = (
        24,
        "given up, because PV got worse or hardly better",
        "identify again without compensation",
    )
    TRAVEL = (
        25,
        "given up, because the valve's travel was over its budget",
        "identify again, or raise travel_budget",
    )
    LEFT_RANGE = (
        26,
        "given up, because the error left its known range",
        "check the gain's sign and the dead time, and identify again",
    )
    OTHER = (27, "withdrawn by an operator or for another reason", "ask the operator")

    def __init__(self, code: int, text: str, advice: str) -> None:
        self.code = code
        self.text = text
        self.advice = advice

    @classmethod
    def from_code(cls, code: int) -> Refusal | None:
        """Return the refusal that an ``ack_refusal`` stands for; None for 0.

        A code that is not known counts as `OTHER`: the model is refused, whatever the reason.
        """
        if code == 0:
            return None
        return next((refusal for refusal in cls if refusal.code == code), cls.OTHER)


class BlockError(FieldlinkError, ValueError):
    """A block that must not be sent or used; ``reason`` is the typed cause."""

    def __init__(self, reason: BlockFault, detail: str = "") -> None:
        self.reason = reason
        self.detail = detail
        super().__init__(f"{reason.text}{f' ({detail})' if detail else ''}; {reason.advice}")


def describe_ack(code: int) -> str:
    """Return what an ``ack_result`` says, with advice where it is a rejection."""
    if code == NOTHING_SEEN:
        return "the PLC has not seen a block yet"
    if code == ACCEPTED:
        return "accepted"
    fault = BlockFault.from_code(code)
    if fault is None:
        return f"unknown result code {code}; bring reader and writer to one release"
    return f"rejected: {fault.text}; {fault.advice}"
