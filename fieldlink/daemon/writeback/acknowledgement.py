"""The PLC's answer to a committed block, awaited for a limited time."""

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

    @property
    def is_awaited(self) -> bool:
        """Whether an answer is open."""
        return self._attempt is not None

    def carry_over(self, other: Acknowledgement) -> None:
        """Go on waiting for the answer that another one waits for."""
        self._attempt, self._until = other._attempt, other._until

    def expect(self, attempt: Attempt) -> None:
        """Wait for the answer to a committed attempt; the time counts from the next look."""
        self._attempt, self._until = attempt, None

    def look(self, control: ControlWords, now: float) -> Attempt | None:
        """Return the outcome of the attempt; None while that is open, or nothing is awaited."""
        attempt = self._attempt
        if attempt is None:
            return None
        assert attempt.block is not None
        assert attempt.bank is not None
        if self._until is None:
            self._until = now + self._patience
        committed = commit_word(attempt.bank, attempt.block.seq)
        is_named = control.ack_seq == attempt.block.seq and control.ack_result == ACCEPTED
        # A PLC that names another bank uses another block, whatever number it says.
        if is_named and control.active_bank == attempt.bank:
            found = attempt.became(WritebackOutcome.ACCEPTED, "")
        elif control.ack_commit == committed and control.ack_result != ACCEPTED:
            found = attempt.became(WritebackOutcome.REJECTED, describe_ack(control.ack_result))
        elif now >= self._until:
            reason = (
                f"ack_seq is {control.ack_seq}, active_bank {control.active_bank} after "
                f"{self._patience:g} s"
            )
            if control.commit != committed:
                # The best block reader cannot answer what it does not get.
                reason += (
                    f", and the commit register holds {control.commit:#06x} instead of "
                    f"{committed:#06x} as written: look at its address, and for a program that "
                    "writes it"
                )
            found = attempt.became(WritebackOutcome.NOT_ACKNOWLEDGED, reason)
        else:
            return None
        self._attempt = None
        return found
