"""Who reads a report: which loops and columns of the list, and whether pages of evidence follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fieldlink.worklist.finding import Wrong
from fieldlink.worklist.from_store import ReportedLoop
from fieldlink.worklist.row import WorkRow
from fieldlink.worklist.texts import (
    brief_confidence,
    duration_text,
    limit_text,
    number,
    outage_text,
    share_text,
    state_text,
    trend_text,
    two_lines,
    wrong_text,
)

__all__ = ["AUDIENCES", "Audience", "Column", "needs_picture"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the list.

    Attributes:
        title: its heading.
        text: the cell of a row.
        width: share of the page, relative to the other columns.
        is_number: whether it is aligned to the right.
    """

    title: str
    text: Callable[[WorkRow], str]
    width: float
    is_number: bool = False


def _travel(row: WorkRow) -> str:
    figures = row.figures
    return f"{number(figures.travel_per_day)}\n{number(figures.reversals_per_day)}"


_LOOP = Column("loop", lambda row: row.tag, 5.5)
_WRONG = Column("what is wrong", wrong_text, 7.0)
_BAND = Column("S, %\n[interval]", lambda row: two_lines(row.stick_band), 5.0, True)
_JUMP = Column("J, %\n[interval]", lambda row: two_lines(row.slip_jump), 5.0, True)
_TREND = Column("trend, %\nin 30 days", lambda row: trend_text(row.trend), 4.2, True)
_LIMIT = Column("S at its\nlimit in", limit_text, 5.2, True)
_TRAVEL = Column("travel, %/day\nreversals/day", _travel, 5.0, True)
_PERIOD = Column("period", lambda row: duration_text(row.figures.period_s), 4.0, True)
_LOSS = Column("avoidable", lambda row: share_text(row.figures.loss), 4.0, True)
_SURE = Column("confidence", brief_confidence, 4.8)
_ACTION = Column("action", lambda row: row.finding.action.brief, 8.0)
_OUTAGE = Column("outage", outage_text, 3.4)
_OWNER = Column("owner", lambda row: "–" if row.item is None else row.item.owner or "–", 4.0)
_STATE = Column("state", state_text, 4.6)
_NOTE = Column("note", lambda row: "" if row.item is None else row.item.note, 8.0)


@dataclass(frozen=True, slots=True)
class Audience:
    """What a report shows to one audience.

    Attributes:
        name: technician, engineer or manager.
        question: what this reader asks.
        columns: of the list.
        shows_quiet: whether loops with nothing to do are listed one by one.
        shows_evidence: whether a page of evidence follows for each loop with work.
        shows_repairs: whether a table of repairs with before and after stands on page one.
    """

    name: str
    question: str
    columns: tuple[Column, ...]
    shows_quiet: bool
    shows_evidence: bool
    shows_repairs: bool

    @property
    def legend(self) -> str:
        """What the letters and shares in the columns mean."""
        said = ["S: stick band, J: slip jump, in % of OP's span."]
        if _JUMP not in self.columns:
            said = ["S: stick band" + (", in % of OP's span." if _BAND in self.columns else ".")]
        if _LOSS in self.columns:
            said.append("Avoidable: share of PV's variance that sticking makes.")
        if _TRAVEL in self.columns:
            said.append("Travel and reversals are those of OP.")
        return " ".join(said)

    def choose(self, loops: Sequence[ReportedLoop]) -> list[ReportedLoop]:
        """Return the loops of the list, in their order."""
        return [loop for loop in loops if self.shows_quiet or is_work(loop.row)]


def is_work(row: WorkRow) -> bool:
    """Whether a loop has a fault, or work that is not verified yet."""
    return row.finding.wrong is not Wrong.QUIET or row.state in ("open", "planned", "done")


def needs_picture(loop: ReportedLoop) -> bool:
    """Whether pictures help: where something is wrong, or a repair is to be judged."""
    return is_work(loop.row) or loop.row.repair is not None


AUDIENCES = {
    audience.name: audience
    for audience in (
        Audience(
            "technician",
            "Which valve is repaired at the next stop, and how is that known?",
            (_LOOP, _WRONG, _BAND, _LIMIT, _SURE, _ACTION, _OUTAGE, _OWNER, _STATE, _NOTE),
            shows_quiet=False,
            shows_evidence=True,
            shows_repairs=False,
        ),
        Audience(
            "engineer",
            "What is wrong in each loop, and what is the evidence?",
            (
                _LOOP, _WRONG, _BAND, _JUMP, _TREND, _LIMIT, _TRAVEL, _PERIOD, _LOSS,
                _SURE, _ACTION, _OUTAGE, _OWNER, _STATE,
            ),
            shows_quiet=True,
            shows_evidence=True,
            shows_repairs=False,
        ),
        Audience(
            "manager",
            "What has to be done, what does it cost to wait, and what did the repairs bring?",
            (_LOOP, _WRONG, _LOSS, _LIMIT, _ACTION, _OUTAGE, _OWNER, _STATE),
            shows_quiet=False,
            shows_evidence=False,
            shows_repairs=True,
        ),
    )
}  # fmt: skip
"""By name."""
