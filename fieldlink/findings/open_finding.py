"""A finding that is not closed yet, and its form in the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from fieldlink.store import FindingRecord

__all__ = ["OpenFinding", "State", "Trial"]


class State(StrEnum):
    """Where a finding is in its life."""

    WATCH = "watch"
    CONFIRMED = "confirmed"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class Trial:
    """The candidate of a group was repaired or put in manual; the others show if it was the source.

    Attributes:
        loop: the candidate.
        utc_ms: since when it is so.
        what: ``"repaired"`` or ``"in manual"``.
    """

    loop: str
    utc_ms: int
    what: str

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain types."""
        return {"loop": self.loop, "utc_ms": self.utc_ms, "what": self.what}


@dataclass(frozen=True, slots=True)
class OpenFinding:
    """A finding as the ledger keeps it.

    Attributes:
        id: never changes.
        born_ms: when it was first seen.
        state: watch or confirmed.
        cause: name of the cause.
        loop: that has it; empty where it is none of the loops.
        loops: all that swing because of it, the loop itself included.
        swing_period_s: of the oscillation; None where there is none.
        weight: of the cause; of the first candidate, for a group.
        evidence, action: as in the newest diagnosis that saw it.
        candidates: of a group, as in ``fieldlink diagnose --json``.
        seen, missed: diagnoses that saw it, and those in a row that did not.
        alone: diagnoses in a row that saw the source of a group and none of the others swing.
        seen_ms: end of the newest window that saw it.
        trial: see `Trial`; None where there is none.
    """

    id: str
    born_ms: int
    state: State
    cause: str
    loop: str
    loops: tuple[str, ...]
    swing_period_s: float | None
    weight: float
    evidence: tuple[str, ...]
    action: str
    candidates: tuple[Mapping[str, Any], ...] = ()
    seen: int = 1
    missed: int = 0
    alone: int = 0
    seen_ms: int = 0
    trial: Trial | None = None

    @property
    def is_group(self) -> bool:
        """Whether several loops swing because of it."""
        return len(self.loops) > 1

    @property
    def others(self) -> tuple[str, ...]:
        """The loops that swing because of another one."""
        return tuple(name for name in self.loops if name != self.loop)

    def record(
        self, utc_ms: int, message: str, *, followed: Mapping[str, Any] | None = None
    ) -> FindingRecord:
        """Return the row that says how it is now.

        Args:
            utc_ms: the moment.
            message: what is new.
            followed: after a trial: how the others swing.
        """
        document: dict[str, object] = {
            "evidence": list(self.evidence),
            "action": self.action,
            "candidates": [dict(one) for one in self.candidates],
            "seen": self.seen,
            "seen_ms": self.seen_ms,
            "trial": None if self.trial is None else self.trial.to_dict(),
            "followed": None if followed is None else dict(followed),
        }
        return FindingRecord(
            finding=self.id,
            utc_ms=utc_ms,
            born_ms=self.born_ms,
            state=self.state.value,
            cause=self.cause,
            loop=self.loop,
            loops=self.loops,
            swing_period_s=self.swing_period_s,
            weight=self.weight,
            message=message,
            document=document,
        )

    @classmethod
    def of_record(cls, record: FindingRecord) -> OpenFinding:
        """Go on with a finding that an earlier process stored."""
        document: Mapping[str, Any] = record.document or {}
        trial = document.get("trial")
        return cls(
            id=record.finding,
            born_ms=record.born_ms,
            state=State(record.state),
            cause=record.cause,
            loop=record.loop,
            loops=tuple(record.loops),
            swing_period_s=record.swing_period_s,
            weight=record.weight or 0.0,
            evidence=tuple(document.get("evidence", ())),
            action=str(document.get("action", "")),
            candidates=tuple(document.get("candidates", ())),
            seen=int(document.get("seen", 1)),
            seen_ms=int(document.get("seen_ms", record.utc_ms)),
            trial=None if trial is None else Trial(**trial),
        )

    def renamed(self, names: Mapping[str, str]) -> OpenFinding:
        """Return it with new names of loops, by their former ones."""

        def now(name: str) -> str:
            return names.get(name, name)

        trial = None if self.trial is None else replace(self.trial, loop=now(self.trial.loop))
        candidates = tuple(
            {**one, "loop": None if one["loop"] is None else now(one["loop"])}
            for one in self.candidates
        )
        return replace(
            self,
            loop=now(self.loop),
            loops=tuple(map(now, self.loops)),
            candidates=candidates,
            trial=trial,
        )

    def closed(self) -> OpenFinding:
        """Return it closed."""
        return replace(self, state=State.CLOSED)
