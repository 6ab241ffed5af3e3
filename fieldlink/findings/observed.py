"""What one round of diagnoses saw: each loop's causes, the groups, and what was repaired."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["CauseSeen", "ObservedGroup", "ObservedLoop", "Repair", "Round"]

SAME_PERIOD = 0.15
"""Periods nearer than this share are one oscillation: zero crossings of a noisy record of ten
periods give it to a tenth."""

WHOLLY_MANUAL = 0.95
"""Weight of the cause manual from which at least nine tenths of the window were in manual."""


@dataclass(frozen=True, slots=True)
class CauseSeen:
    """One cause of a diagnosis; see `estimator.diagnosis.Cause`."""

    name: str
    weight: float
    evidence: tuple[str, ...] = ()
    action: str = ""


@dataclass(frozen=True, slots=True)
class ObservedLoop:
    """A loop's newest window.

    Attributes:
        begin_ms, end_ms: stamps of its first and last slot, UTC milliseconds.
        causes: the heaviest first.
        swing_period_s: of the oscillation; None where nothing oscillates.
        compensated: whether a block may have been in force: a sticky valve does not show then.
        manual_since_ms: when the controller left automatic; None where it is in automatic at the
            end of the window.
    """

    begin_ms: int
    end_ms: int
    causes: tuple[CauseSeen, ...]
    swing_period_s: float | None = None
    compensated: bool = False
    manual_since_ms: int | None = None

    @classmethod
    def of_document(
        cls,
        document: Mapping[str, Any],
        begin_ms: int,
        end_ms: int,
        *,
        compensated: bool = False,
        manual_since_ms: int | None = None,
    ) -> ObservedLoop:
        """Take over a diagnosis (`estimator.diagnosis.Diagnosis.to_dict`)."""
        swing = document["oscillation"]
        return cls(
            begin_ms,
            end_ms,
            tuple(
                CauseSeen(
                    str(one["name"]),
                    float(one["weight"]),
                    tuple(map(str, one["evidence"])),
                    str(one["action"]),
                )
                for one in document["causes"]
            ),
            float(swing["period_s"]) if swing["present"] and swing["period_s"] else None,
            compensated,
            manual_since_ms,
        )

    def cause(self, name: str) -> CauseSeen | None:
        """Return a cause by name; None where it was not seen."""
        return next((one for one in self.causes if one.name == name), None)

    @property
    def is_in_manual(self) -> bool:
        """Whether being in manual is one of its causes."""
        return self.cause("manual") is not None

    @property
    def is_wholly_in_manual(self) -> bool:
        """Whether nearly all of the window was in manual."""
        found = self.cause("manual")
        return found is not None and found.weight >= WHOLLY_MANUAL

    def swings_with(self, period_s: float | None) -> bool:
        """Whether it oscillates with this period."""
        if period_s is None or self.swing_period_s is None:
            return False
        return abs(self.swing_period_s / period_s - 1.0) < SAME_PERIOD


@dataclass(frozen=True, slots=True)
class ObservedGroup:
    """Loops that swing together; ``candidates`` as in ``fieldlink diagnose --json``."""

    loops: tuple[str, ...]
    period_s: float
    candidates: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True, slots=True)
class Repair:
    """What somebody noted about a loop: when, and in which words."""

    utc_ms: int
    note: str


@dataclass(frozen=True, slots=True)
class Round:
    """One round of diagnoses.

    Attributes:
        utc_ms: when it ended.
        loops: what was diagnosed in it, by loop; one without enough new samples is left out.
        groups: those that swing together.
        known: every loop of the site.
        repairs: the newest of each loop.
    """

    utc_ms: int
    loops: Mapping[str, ObservedLoop]
    known: frozenset[str]
    groups: tuple[ObservedGroup, ...] = ()
    repairs: Mapping[str, Repair] = field(default_factory=dict)
