"""What is stored: one frozen record a row, and how it becomes that row."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

from sqlalchemy import Table

from fieldlink.store.schema import (
    DIAGNOSES,
    ESTIMATES,
    EVENTS,
    FINDINGS,
    SAMPLES,
    SLOTS,
    WORK,
    WRITEBACKS,
)

__all__ = [
    "DiagnosisRecord",
    "EstimateRecord",
    "EventRecord",
    "FindingRecord",
    "Record",
    "SampleRecord",
    "SlotRecord",
    "WorkRecord",
    "WritebackRecord",
]


@dataclass(frozen=True, slots=True)
class Record:
    """A row to be: every field is a column of ``table``; a number that is not finite is NULL.

    Characters that UTF-8 or a database cannot hold are question marks: people and devices write
    texts, and one of them must not cost the row, nor stop the broker's messages.
    """

    table: ClassVar[Table]

    def row(self) -> dict[str, object]:
        """Return the columns."""
        return {field.name: _storable(getattr(self, field.name)) for field in fields(self)}


@dataclass(frozen=True, slots=True)
class SampleRecord(Record):
    """One sample of a loop as it entered the window.

    Attributes:
        loop: its name.
        utc_ms: when the values were read.
        slot: the sample's number in the window's numbering; gaps are missed samples.
        op, pv, sp: NaN where bad; ``sp`` and ``auto`` None where the loop has no such tag.
        auto: whether the controller was in automatic.
        quality: code of the worst of the signals (`fieldlink.links.Quality`).
        late_ms: milliseconds from the moment the poll was due to its reply; None in lockstep.
        clock_steps: how often the wall clock has stepped since the daemon began: stamps of rows
            with different counts cannot be compared, their slots can.
    """

    table: ClassVar[Table] = SAMPLES
    loop: str
    utc_ms: int
    slot: int
    op: float
    pv: float
    sp: float | None
    auto: bool | None
    quality: int
    late_ms: int | None = None
    clock_steps: int = 0

    def row(self) -> dict[str, object]:
        """Return the columns; written out because it runs for every sample."""
        op, pv, sp = self.op, self.pv, self.sp
        return {
            "loop": self.loop,
            "utc_ms": self.utc_ms,
            "slot": self.slot,
            "op": op if math.isfinite(op) else None,
            "pv": pv if math.isfinite(pv) else None,
            "sp": sp if sp is not None and math.isfinite(sp) else None,
            "auto": self.auto,
            "quality": self.quality,
            "late_ms": self.late_ms,
            "clock_steps": self.clock_steps,
        }


@dataclass(frozen=True, slots=True)
class SlotRecord(Record):
    """The counts of a loop's slots in the ``seconds`` before ``utc_ms``.

    ``expected = read + bad + missed``; ``late`` are those of ``read`` and ``bad`` whose reply came
    more than a tenth of a period after it was due.
    """

    table: ClassVar[Table] = SLOTS
    loop: str
    utc_ms: int
    seconds: float
    expected: int
    read: int
    late: int
    missed: int
    bad: int
    duplicates: int
    restarts: int


@dataclass(frozen=True, slots=True)
class EstimateRecord(Record):
    """What the estimator made of a window, or why it made nothing of it."""

    table: ClassVar[Table] = ESTIMATES
    loop: str
    utc_ms: int
    window_end_ms: int
    first_slot: int
    last_slot: int
    outcome: str
    message: str
    verdict: str | None = None
    score: float | None = None
    stick_band: float | None = None
    stick_band_low: float | None = None
    stick_band_high: float | None = None
    slip_jump: float | None = None
    slip_jump_low: float | None = None
    slip_jump_high: float | None = None
    confidence: float | None = None
    r2: float | None = None
    criterion: str | None = None
    seconds: float | None = None
    document: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True)
class WritebackRecord(Record):
    """One attempt to write a block, or one decision not to.

    Attributes:
        words: the block's registers, None when nothing was to be written.
        bank_before: the registers of the written bank before the write.
        active_before: the registers of the active bank at that time.
    """

    table: ClassVar[Table] = WRITEBACKS
    loop: str
    utc_ms: int
    outcome: str
    reason: str
    seq: int | None = None
    bank: str | None = None
    status: str | None = None
    stick_band: float | None = None
    slip_jump: float | None = None
    words: Sequence[int] | None = None
    bank_before: Sequence[int] | None = None
    active_before: Sequence[int] | None = None


@dataclass(frozen=True, slots=True)
class EventRecord(Record):
    """Something that happened to the daemon, a device or the store."""

    table: ClassVar[Table] = EVENTS
    utc_ms: int
    kind: str
    source: str
    message: str
    detail: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True)
class WorkRecord(Record):
    """A note on the work on a loop; the newest row of a loop counts.

    Attributes:
        loop: its name.
        utc_ms: when it was noted.
        state: open, planned, done or verified.
        owner: who does the work; empty where nobody does yet.
        note: in words.
        author: who said it.
    """

    table: ClassVar[Table] = WORK
    loop: str
    utc_ms: int
    state: str
    owner: str
    note: str
    author: str


@dataclass(frozen=True, slots=True)
class DiagnosisRecord(Record):
    """Why a loop swings, by one of its windows.

    Attributes:
        loop: its name.
        utc_ms: when the diagnosis came.
        window_begin_ms, window_end_ms: stamps of the window's first and last slot.
        outcome: the outcome of the request, in the words of an estimate's outcome.
        compensated: whether a block may have been in force during the window.
        message: why there is no diagnosis; empty where there is one.
        cause, weight: the heaviest cause; None without a diagnosis.
        swing_period_s: of the main oscillation; None where nothing oscillates.
        document: the diagnosis as ``fieldlink diagnose --json`` prints it.
    """

    table: ClassVar[Table] = DIAGNOSES
    loop: str
    utc_ms: int
    window_begin_ms: int
    window_end_ms: int
    outcome: str
    compensated: bool
    message: str
    cause: str | None = None
    weight: float | None = None
    swing_period_s: float | None = None
    document: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True)
class FindingRecord(Record):
    """A finding as of one moment; the newest row of a finding counts, the others are its course.

    Attributes:
        finding: its id, which never changes.
        utc_ms, born_ms: when this was found, and when the finding began.
        state: watch, confirmed or closed.
        cause: name of the cause, as in a diagnosis.
        loop: the loop that has the cause; empty where it is none of the loops.
        loops: all loops that swing because of it.
        swing_period_s: of the oscillation; None where there is none.
        weight: of the cause, or of the likeliest candidate of a group; 0 to 1.
        message: what is new, one sentence.
        document: evidence, action, candidates, and what happened after a repair.
    """

    table: ClassVar[Table] = FINDINGS
    finding: str
    utc_ms: int
    born_ms: int
    state: str
    cause: str
    loop: str
    loops: Sequence[str]
    swing_period_s: float | None
    weight: float | None
    message: str
    document: Mapping[str, object] | None = None


_NO_TEXT = re.compile("[\0\ud800-\udfff]")
"""What PostgreSQL, and what UTF-8, has no room for: NUL, and halves of a pair of UTF-16."""


def _storable(value: object) -> object:
    """Numbers that are not finite become None, in documents too: JSON has no word for them."""
    if isinstance(value, str):
        return value if value.isprintable() else _NO_TEXT.sub("?", value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _storable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_storable(item) for item in value]
    return value
