"""The windows that were judged during a demonstration: which one is a block's?"""

from __future__ import annotations

from fieldlink.daemon import Estimate, Findings

__all__ = ["JudgedWindows"]


class JudgedWindows:
    """Keeps every judged window: a block may be accepted after the next window was judged."""

    def __init__(self) -> None:
        self._judged: list[Estimate] = []

    def note(self, newest: Estimate | None) -> None:
        """Keep the newest estimate, once; without findings it makes no block."""
        if newest is None or newest.findings is None:
            return
        if not self._judged or self._judged[-1] is not newest:
            self._judged.append(newest)

    def slots_of(self, findings: Findings) -> tuple[int, int] | None:
        """Return the first and the last slot of the window whose valve the findings name.

        The surest of the windows that agree lends a block its valve (`Candidate`). None where no
        noted window has this valve.
        """
        for estimate in self._judged:
            judged = estimate.findings
            if judged is not None and judged.stick_band is findings.stick_band:
                return estimate.first_slot, estimate.last_slot
        return None
