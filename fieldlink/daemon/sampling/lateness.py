"""How late replies come after the moment they were due, counted in classes as Prometheus wants."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

__all__ = ["BOUNDS", "Lateness", "LatenessReport"]

BOUNDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Upper bounds of the classes in seconds; the last class has none."""


@dataclass(frozen=True, slots=True)
class LatenessReport:
    """Counts by class (one more than `BOUNDS`), and the sum and the largest of all, in seconds."""

    counts: tuple[int, ...] = (0,) * (len(BOUNDS) + 1)
    total: float = 0.0
    largest: float = 0.0


class Lateness:
    """Counts."""

    def __init__(self) -> None:
        self._counts = [0] * (len(BOUNDS) + 1)
        self._total = 0.0
        self._largest = 0.0

    def note(self, seconds: float) -> None:
        """Count one reply."""
        self._counts[bisect_left(BOUNDS, seconds)] += 1
        self._total += seconds
        if seconds > self._largest:
            self._largest = seconds

    def report(self) -> LatenessReport:
        """Return the counts so far."""
        return LatenessReport(tuple(self._counts), self._total, self._largest)
