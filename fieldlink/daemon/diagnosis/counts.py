"""Counts of the rounds and the open findings, for status, metrics and pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fieldlink.findings import OpenFinding

__all__ = ["FindingsReport"]


@dataclass(frozen=True, slots=True)
class FindingsReport:
    """Counts and open findings of the rounds so far.

    Attributes:
        rounds: rounds that ended.
        diagnosed: windows by outcome, in the words of an estimate's outcome.
        open: the findings that are not closed, the oldest first.
        causes: by loop, the heaviest cause of its newest diagnosis.
    """

    rounds: int = 0
    diagnosed: Mapping[str, int] = field(default_factory=dict)
    open: tuple[OpenFinding, ...] = ()
    causes: Mapping[str, str] = field(default_factory=dict)
