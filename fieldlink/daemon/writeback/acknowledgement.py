"""The PLC's answer to a committed block, awaited for a limited time, and taken when it is late."""

from __future__ import annotations

from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.registers import ACCEPTED, commit_word, describe_ack

__all__ = ["Acknowledgement"]

ACK_WAIT = 10.0
"""Plant seconds that a PLC may take to acknowledge, or four periods of the loop if that is more."""


class Acknowledgement:
    """Waits for the answer to one attempt.

    Args:
        period: plant seconds of the loop's period.
    """

    def __init__(self, period: float) -> None:
        self._patience = max(ACK_WAIT, 4.0 * period)
        self._attempt: Attempt | None = None
        self._until: float | None = None
        self._given_up: Attempt | None = None

    @property
    def is_awaited(self) -> bool:
        """Whether an answer is open."""
        return self._attempt is not None

    def carry_over(self, other: Acknowledgement) -> None:
        """Go on waiting for the answer that another one waits for."""
        self._attempt, self._until = other._attempt, other._until
        self._given_up = other._given_up

    def expect(self, attempt: Attempt) -> None:
        """Wait for the answer to a committed attempt; the time counts from the next look."""
        self._attempt, self._until, self._given_up = attempt, None, None

    def look(self, control: ControlWords, now: float) -> Attempt | None:
        """Return the outcome of the attempt; None while that is open, or nothing is awaited.

        An answer that comes after the time for it is an outcome as well, until another block is
        committed: the PLC uses the block then, and the record must not say otherwise.
        """
        if self._attempt is None:
            return self._late(control, now)
        if self._until is None:
            self._until = now + self._patience
        found = _answer(self._attempt, control)
        if found is None and now >= self._until:
            found = self._attempt.became(
                WritebackOutcome.NOT_ACKNOWLEDGED, self._silence(self._attempt, control)
            )
            self._given_up = self._attempt
        if found is not None:
            self._attempt = None
        return found

    def _late(self, control: ControlWords, now: float) -> Attempt | None:
        found = None if self._given_up is None else _answer(self._given_up, control)
        if found is None or self._until is None:
            return None
        self._given_up = None
        after = now - self._until + self._patience
        late = (
            f"the PLC answered {after:.0f} s after the commit: let its block reader run each scan"
        )
        return found.became(
            found.outcome, "; ".join(words for words in (found.reason, late) if words)
        )

    def _silence(self, attempt: Attempt, control: ControlWords) -> str:
        reason = (
            f"ack_seq is {control.ack_seq}, active_bank {control.active_bank} after "
            f"{self._patience:g} s"
        )
        if control.commit != (committed := _committed(attempt)):
            # The best block reader cannot answer what it does not get.
            reason += (
                f", and the commit register holds {control.commit:#06x} instead of "
                f"{committed:#06x} as written: look at its address, and for a program that "
                "writes it"
            )
        return reason


def _committed(attempt: Attempt) -> int:
    assert attempt.block is not None
    assert attempt.bank is not None
    return commit_word(attempt.bank, attempt.block.seq)


def _answer(attempt: Attempt, control: ControlWords) -> Attempt | None:
    """Return the PLC's answer to an attempt; None while there is none."""
    assert attempt.block is not None
    is_named = control.ack_seq == attempt.block.seq and control.ack_result == ACCEPTED
    # A PLC that names another bank uses another block, whatever number it says.
    if is_named and control.active_bank == attempt.bank:
        return attempt.became(WritebackOutcome.ACCEPTED, "")
    if control.ack_commit == _committed(attempt) and control.ack_result != ACCEPTED:
        return attempt.became(WritebackOutcome.REJECTED, describe_ack(control.ack_result))
    return None
