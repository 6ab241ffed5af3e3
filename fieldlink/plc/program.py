"""What a loop's program does in one control cycle, whatever stands behind it.

Two kinds are here: `ReplayedLoop` plays a recording, `fieldlink.plc.control.ControlledLoop` runs a
controller on a plant. A third kind is a class with these two methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from fieldlink.errors import FieldlinkError
from fieldlink.plc.truth import CycleRecord
from fieldlink.site.recording import Recording
from loop_model import LoopModel

__all__ = ["Commands", "LoopFailedError", "LoopProgram", "ReplayedLoop"]


class LoopFailedError(FieldlinkError):
    """What stands behind a loop has failed; the loop stops, the rest of the PLC goes on."""


@dataclass(frozen=True, slots=True)
class Commands:
    """What the operator and Fieldlink ask of a cycle.

    Attributes:
        automatic: whether the controller may compute OP.
        op: OP to apply while not automatic; NaN holds the last one.
        sp: set-point; NaN takes the program's own.
        model: what the accepted parameter block says; None without one in force.
        withdrawn: why there is no model.
    """

    automatic: bool = True
    op: float = math.nan
    sp: float = math.nan
    model: LoopModel | None = None
    withdrawn: str = ""


class LoopProgram(Protocol):
    """One loop, one cycle at a time."""

    def cycle(self, commands: Commands) -> CycleRecord:
        """Run one control cycle and return what it did.

        Raises:
            LoopFailedError: the plant behind the loop has failed; do not call again.
        """

    def close(self) -> None:
        """Let go of what stands behind the loop; may be called twice."""


class ReplayedLoop:
    """Plays a recording, one row a cycle; nothing that is asked of it changes a recorded row.

    After the last row the signals stay where they are and the loop reports manual: a jump back to
    the first row would be an upset that never happened, and an identification across it wrong.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._row = 0

    @property
    def ended(self) -> bool:
        """Whether the last row has been played."""
        return self._row >= len(self._recording.op)

    def cycle(self, commands: Commands) -> CycleRecord:  # noqa: ARG002
        """Return the next row."""
        recording = self._recording
        row = min(self._row, len(recording.op) - 1)
        automatic = not self.ended and (recording.auto is None or bool(recording.auto[row]))
        self._row += 1
        return CycleRecord(
            op=float(recording.op[row]),
            pv=float(recording.pv[row]),
            sp=math.nan if recording.sp is None else float(recording.sp[row]),
            stem=math.nan,
            automatic=automatic,
            compensated=False,
        )

    def close(self) -> None:
        """Nothing to let go of."""
