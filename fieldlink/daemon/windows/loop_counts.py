"""The counts of one loop's samples."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LoopCounts"]


@dataclass(frozen=True, slots=True)
class LoopCounts:
    """The counts of a loop's samples; ``expected = read + bad + missed``.

    Attributes:
        expected: slots from the first poll on, by the controller's count where there is one, and
            by the clock while no samples come.
        read: slots filled with good OP and PV.
        bad: slots filled with a value of bad quality.
        missed: slots left empty.
        late: slots read (good or bad) whose reply came more than a tenth of a period after it was
            due.
        duplicates: readings of a sample that was there already.
        restarts: times the controller's cycle counter started again.
    """

    expected: int = 0
    read: int = 0
    bad: int = 0
    missed: int = 0
    late: int = 0
    duplicates: int = 0
    restarts: int = 0
