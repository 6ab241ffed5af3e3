"""A loop without good samples although its device answers: an event, and one when they come."""

from __future__ import annotations

import math

from fieldlink.daemon.reporting.journal import Journal
from fieldlink.links import Quality, Scan
from fieldlink.site import Loop
from fieldlink.store import SampleRecord

__all__ = ["SilenceWatch", "fault_of"]

SILENT_AFTER = 20
"""Periods without a good sample after which a loop counts as silent."""

_ADVICE = {quality.code: quality.advice for quality in Quality}


def fault_of(sample: SampleRecord | None, loop: Loop, scan: Scan | None = None) -> str:
    """Return which tags of a bad sample are bad, and why; empty for a good one and for none.

    Args:
        sample: the sample.
        loop: whose it is.
        scan: that it comes from, which has the status codes of a server.
    """
    if sample is None or sample.quality == 0:
        return ""
    tags = [tag for tag, value in ((loop.op, sample.op), (loop.pv, sample.pv)) if math.isnan(value)]
    named = tags or [loop.op, loop.pv]
    statuses = {scan[tag].status for tag in named} - {""} if scan is not None else set()
    status = f" (status {', '.join(sorted(statuses))})" if statuses else ""
    return f"{' and '.join(named)}: {_ADVICE[sample.quality]}{status}"


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
        self._good_at: float | None = None
        self._fault = ""
        self._silent = False

    def carry_over(self, other: SilenceWatch) -> None:
        """Go on where another one was."""
        self._sampled_at, self._silent = other._sampled_at, other._silent
        self._good_at, self._fault = other._good_at, other._fault

    def idle(self, now: float) -> float:
        """Return the plant seconds since the last sample; 0 before the first look."""
        return 0.0 if self._sampled_at is None else now - self._sampled_at

    def look(self, now: float, *, sampled: bool, answers: bool, fault: str = "") -> None:
        """Report when the loop has no good samples although its device answers, and when it has.

        Args:
            now: plant seconds.
            sampled: whether there is a new sample.
            answers: whether the device answers.
            fault: why the new sample is bad; empty when it is good.
        """
        if sampled or self._sampled_at is None:
            self._sampled_at = now
        if sampled:
            self._fault = fault
        good = sampled and not fault
        since = now if self._good_at is None else self._good_at
        self._good_at = now if good else since
        if good and self._silent:
            self._silent = False
            self._journal.event(
                "loop.sampled", self._name, f"good samples after {now - since:.0f} s"
            )
        limit = SILENT_AFTER * self._period
        if now - self._good_at > limit and not self._silent and answers:
            self._silent = True
            still_come = now - self._sampled_at < 0.5 * limit
            self._journal.event(
                "loop.silent",
                self._name,
                f"no good sample for {now - since:.0f} s: "
                + (
                    (self._fault if still_come else "")
                    or "OP or PV cannot be read, or the cycle counter stands still; look at the "
                    "tags and whether the controller runs"
                ),
                bad=True,
            )
