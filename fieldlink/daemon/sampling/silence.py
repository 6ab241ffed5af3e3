"""A loop that gets no samples although its device answers: told once, and again when they come."""

from __future__ import annotations

from fieldlink.daemon.reporting.journal import Journal

__all__ = ["SilenceWatch"]

SILENT_AFTER = 20
"""Periods without a new sample after which a loop counts as silent."""


class SilenceWatch:
    """Watches the samples of one loop.

    Args:
        name: the loop's name.
        period: plant seconds of its period.
        journal: takes the events.
    """

    def __init__(self, name: str, period: float, journal: Journal) -> None:
        self._name = name
        self._period = period
        self._journal = journal
        self._sampled_at: float | None = None
        self._silent = False

    def carry_over(self, other: SilenceWatch) -> None:
        """Go on where another one was."""
        self._sampled_at, self._silent = other._sampled_at, other._silent

    def idle(self, now: float) -> float:
        """Return the plant seconds since the last sample; 0 before the first look."""
        return 0.0 if self._sampled_at is None else now - self._sampled_at

    def look(self, now: float, *, sampled: bool, answers: bool) -> None:
        """Tell when the loop has no new samples although its device answers, and when it has."""
        if sampled and not self._silent:
            self._sampled_at = now
            return
        since = now if self._sampled_at is None else self._sampled_at
        self._sampled_at = now if sampled else since
        if sampled:
            self._silent = False
            self._journal.event(
                "loop.sampled", self._name, f"new samples after {now - since:.0f} s"
            )
        elif now - since > SILENT_AFTER * self._period and not self._silent and answers:
            self._silent = True
            self._journal.event(
                "loop.silent",
                self._name,
                f"no new sample for {now - since:.0f} s: OP or PV cannot be read, or the cycle "
                "counter stands still; look at the tags and whether the controller runs",
                bad=True,
            )
