"""Sequence numbers of one loop's blocks: none is given twice, whatever starts again."""

from __future__ import annotations

from fieldlink.registers import Bank, commit_word, is_newer, next_seq

__all__ = ["SequenceNumbers"]


class SequenceNumbers:
    """Knows the newest number; belongs to the loop's name and outlives its runner.

    Attributes:
        last: the newest number known, 0 for none.
    """

    def __init__(self, last: int = 0) -> None:
        self.last = last

    def learn(self, seq: int) -> None:
        """Take note of a number that was used; an older one, or 0, changes nothing."""
        if seq and is_newer(seq, self.last):
            self.last = seq

    def take(self, bank: Bank, committed: int) -> int:
        """Return the next number for a bank; its commit word is not the one in the PLC now."""
        self.last = next_seq(self.last)
        if commit_word(bank, self.last) == committed:
            self.last = next_seq(self.last)
        return self.last
