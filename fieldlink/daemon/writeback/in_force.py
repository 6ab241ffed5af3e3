"""What the PLC has in force for a loop, as far as the registers and this process tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.registers import ParameterBlock, Refusal, Status, block_gain

__all__ = ["InForce", "RefusedModel", "has_other_gain", "refusal_of"]

OTHER_GAIN = 3.0
"""Factor between the gains of two models from which they are different ones: at a constant
set-point a window may miss the gain by a factor of three, because J trades against it."""


@dataclass(frozen=True, slots=True)
class RefusedModel:
    """A model that the PLC's controller does not use, since a plant second."""

    block: ParameterBlock
    code: int
    since: float

    def is_same(self, candidate: Candidate, now: float) -> bool:
        """Whether a candidate is that model again: inside its intervals, with its gain."""
        block, found = self.block, candidate.findings
        if candidate.status is not Status.VALID or now - self.since > block.valid_for:
            return False
        if has_other_gain(candidate, block):
            return False
        return all(
            bounded.low <= value <= bounded.high
            for value, bounded in (
                (found.stick_band.value, block.stick_band),
                (found.slip_jump.value, block.slip_jump),
            )
        )


def has_other_gain(candidate: Candidate, block: ParameterBlock) -> bool:
    """Whether the process gains of a candidate and of a block are those of different models.

    They have unlike signs, or one is more than `OTHER_GAIN` times the other.
    """
    model = candidate.findings.model
    if model is None or block.process is None:
        return False
    one, other = block_gain(model.process), block.gain
    if not (math.isfinite(one) and math.isfinite(other)):
        return False
    return one * other < 0.0 or max(abs(one), abs(other)) > OTHER_GAIN * min(abs(one), abs(other))


class InForce:
    """The block that the PLC acknowledges.

    A block of a time before this process counts from the first look at it: at worst it is taken to
    be in force too long.

    Attributes:
        block: the last one with a statement about the valve; None when there is none.
        accepted_at: plant second of its acceptance; None when that was before this process.
    """

    def __init__(self) -> None:
        self.block: ParameterBlock | None = None
        self.accepted_at: float | None = None
        self._since = 0.0
        self._acknowledged: int | None = None

    async def look(self, exchange: Exchange, control: ControlWords, now: float) -> bool:
        """Read the active bank when the PLC acknowledges a block that is not known yet.

        Returns:
            Whether it was read.

        Raises:
            LinkError: it could not be read.
        """
        if control.ack_seq == self._acknowledged:
            return False
        if control.disagreement:
            # What is in force is not known before they agree: it is looked for at every look.
            return False
        block = None
        if control.ack_seq != 0:
            active = control.inactive_bank.other
            block = exchange.decode(await exchange.bank(active))
            if block is not None and block.status is Status.NOT_ASSESSABLE:
                # It left the block before it in force.
                block = exchange.decode(await exchange.bank(active.other))
        self._acknowledged = control.ack_seq
        self.block, self.accepted_at, self._since = block, None, now
        return True

    def lose(self) -> None:
        """Take note that the PLC has cleared the block that it acknowledges."""
        self.block, self.accepted_at = None, None

    def accept(self, block: ParameterBlock, now: float) -> None:
        """Take note of a block that the PLC has just accepted."""
        self._acknowledged = block.seq
        if block.status is Status.NOT_ASSESSABLE:
            return
        self.block, self.accepted_at, self._since = block, now, now

    def valve(self, now: float) -> ParameterBlock | None:
        """Return the sticky valve's block that has not expired; None without one."""
        block = self.block
        if block is None or block.status is not Status.VALID:
            return None
        return block if now - self._since <= block.valid_for else None


def refusal_of(control: ControlWords) -> str:
    """Say why the consumer does not use the accepted model; empty when it does not say so."""
    if not control.ack_refusal:
        return ""
    known = Refusal.from_code(control.ack_refusal)
    assert known is not None
    if known.code != control.ack_refusal:
        return (
            f"refusal code {control.ack_refusal}, which is not one of ours; look at the PLC's "
            "program, and for another client that writes ack_refusal"
        )
    return f"{known.text}; {known.advice}"
