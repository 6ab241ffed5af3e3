"""When to try a silent device again: pauses that double, with jitter, up to a cap."""

from __future__ import annotations

import random
from dataclasses import dataclass

__all__ = ["Backoff", "BackoffSettings", "describe_next"]


@dataclass(frozen=True, slots=True)
class BackoffSettings:
    """How long to pause after failures.

    Attributes:
        first: seconds after the first failure.
        cap: the longest pause in seconds.
        jitter: the share of a pause that is random, so that links do not retry in step.
    """

    first: float = 0.1
    cap: float = 5.0
    jitter: float = 0.3

    def __post_init__(self) -> None:
        if not (0.0 < self.first <= self.cap and 0.0 <= self.jitter < 1.0):
            raise ValueError(f"a backoff needs 0 < first <= cap and 0 <= jitter < 1; got {self}")


class Backoff:
    """Counts failures in a row and says when the next attempt is due."""

    def __init__(
        self, settings: BackoffSettings | None = None, *, rng: random.Random | None = None
    ) -> None:
        self._settings = settings or BackoffSettings()
        self._random = rng or random.Random()
        self._due = 0.0
        self.failures = 0

    def failed(self, now: float) -> None:
        """Note a failure at ``now`` (monotonic seconds)."""
        exponent = min(self.failures, 30)
        self.failures += 1
        pause = min(self._settings.cap, self._settings.first * 2.0**exponent)
        self._due = now + pause * (1.0 - self._settings.jitter * self._random.random())

    def succeeded(self) -> None:
        """Note a success: the next failure starts with the first pause again."""
        self.failures = 0

    def remaining(self, now: float) -> float:
        """Seconds until the next attempt is due; 0 when it is."""
        return max(0.0, self._due - now) if self.failures else 0.0


def describe_next(wait: float, failures: int) -> str:
    """Return when the next attempt is, after so many failures in a row."""
    when = "at once" if wait < 0.05 else f"in {wait:.1f} s"
    return f"next attempt {when} (failures in a row: {failures})"
