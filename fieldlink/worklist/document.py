"""A report as a document: its heading, its list and its pages, the same for screen and paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from fieldlink.worklist.audience import Audience, is_work
from fieldlink.worklist.finding import Wrong
from fieldlink.worklist.from_store import ReportedLoop

__all__ = ["WorkDocument"]


@dataclass(frozen=True, slots=True, eq=False)
class WorkDocument:
    """What a report says.

    Attributes:
        title: what it is about.
        made: when, UTC.
        loops: all, the most urgent first.
        audience: who reads it.
    """

    title: str
    made: datetime
    loops: Sequence[ReportedLoop]
    audience: Audience

    @property
    def subtitle(self) -> str:
        """When and for whom it was made."""
        return f"fieldlink report for the {self.audience.name}, {self.made:%Y-%m-%d %H:%M} UTC"

    @property
    def listed(self) -> list[ReportedLoop]:
        """The loops of the list."""
        return self.audience.choose(self.loops)

    @property
    def evidenced(self) -> list[ReportedLoop]:
        """The loops that have a page of evidence."""
        return self.listed if self.audience.shows_evidence else []

    @property
    def summary(self) -> list[str]:
        """What a meeting has to know first, in sentences."""
        rows = [loop.row for loop in self.loops]
        work = [row for row in rows if is_work(row)]
        sticky = [row for row in rows if row.finding.wrong is Wrong.STICKY_VALVE]
        over = [row for row in sticky if row.stick_band.value >= row.limit]
        open_ = [row for row in rows if row.finding.wrong is Wrong.UNDETERMINED]
        outage = [row for row in work if row.finding.action.needs_outage]
        states = Counter(row.state for row in work)
        told = [
            f"{_count(len(rows), 'loop')}: {_are(len(work))} on the work list, "
            f"{len(rows) - len(work)} with nothing to do.",
            f"{_count(len(sticky), 'valve')} {'sticks' if len(sticky) == 1 else 'stick'}, "
            f"{len(over)} of them over the limit; {_count(len(outage), 'action')} "
            f"{'needs' if len(outage) == 1 else 'need'} an outage.",
        ]
        if open_:
            page = "its page says" if len(open_) == 1 else "their pages say"
            told.append(f"{_count(len(open_), 'loop')} undetermined; {page} what to record.")
        unread = sum(row.finding.wrong is Wrong.UNREADABLE for row in rows)
        if unread:
            why = "its reason is in its row" if unread == 1 else "the reasons are in their rows"
            told.append(f"{_count(unread, 'recording')} cannot be used; {why}.")
        if states:
            counts = ", ".join(f"{count} {state}" for state, count in states.most_common())
            told.append(f"Work: {counts}.")
        return told

    @property
    def repaired(self) -> list[ReportedLoop]:
        """The loops with a repair to be judged."""
        return [loop for loop in self.loops if loop.row.repair is not None]

    def to_dict(self) -> dict[str, Any]:
        """Return the list with all loops as plain types, for ``--json``."""
        return {
            "title": self.title,
            "made": self.made.isoformat(timespec="seconds"),
            "loops": [loop.row.to_dict(rank) for rank, loop in enumerate(self.loops, 1)],
        }


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _are(number: int) -> str:
    return f"{number} is" if number == 1 else f"{number} are"
