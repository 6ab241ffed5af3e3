"""What a loop's program does in one control cycle, whatever stands behind it.

Two kinds are here: `ReplayedLoop` plays a recording, `fieldlink.lab.plc.control.ControlledLoop`
runs a controller on a plant. A third kind is one more class with these members.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from compensator import Supervisor
from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc.plants import HostedPlant
from fieldlink.lab.plc.truth import CycleRecord
from fieldlink.registers import ReaderState, Refusal
from fieldlink.site import Recording

__all__ = ["Commands", "LoopFailedError", "LoopProgram", "ReplayedLoop"]


class LoopFailedError(FieldlinkError):
    """What stands behind a loop has failed; the loop stops, the rest of the PLC goes on."""


class Commands(NamedTuple):
    """What the operator and Fieldlink ask of a cycle.

    Attributes:
        automatic: whether the controller may compute OP.
        op: OP that stands in the tag, where clients may write it; NaN holds the last one.
        sp: set-point.
        block: the outcome of the parameter blocks; None when the loop does not compensate.
        op_was_written: whether a client has written OP since the cycle before.
    """

    automatic: bool
    op: float
    sp: float
    block: ReaderState | None = None
    op_was_written: bool = False


class LoopProgram(Protocol):
    """One loop, one cycle at a time: `begin`, a step of its plant, `end`."""

    @property
    def op(self) -> float:
        """OP as it is applied now."""
        ...

    @property
    def pv(self) -> float:
        """PV as the next cycle will read it."""
        ...

    @property
    def stem(self) -> float:
        """Stem position that the last step led to; NaN where nobody knows it, or not yet."""
        ...

    @property
    def refusal(self) -> Refusal | None:
        """Why the model of the block in force is not used; None if it is, or there is none."""
        ...

    @property
    def supervisor(self) -> Supervisor | None:
        """Who has controller and compensator; None for a loop without."""
        ...

    @property
    def plant(self) -> HostedPlant | None:
        """What is stepped between `begin` and `end`; None without a plant."""
        ...

    def begin(self, commands: Commands) -> None:
        """Begin a control cycle: read, decide, hand over to the plant.

        Raises:
            LoopFailedError: the plant behind the loop has failed; do not call again.
        """
        ...

    def end(self) -> CycleRecord:
        """Return what the cycle did, after the plant was stepped.

        Raises:
            LoopFailedError: the plant failed in that step; do not call again.
        """
        ...

    def close(self) -> None:
        """Let go of what stands behind the loop; may be called twice."""
        ...


class ReplayedLoop:
    """Plays a recording, one row a cycle; nothing that is asked of it changes a recorded row.

    After the last row the signals stay where they are and the loop reports manual: a jump back to
    the first row would be an upset that never happened, and an identification across it wrong.
    """

    plant: HostedPlant | None = None
    stem = math.nan
    refusal: Refusal | None = None
    supervisor: Supervisor | None = None

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._played = 0

    @property
    def op(self) -> float:
        """OP of the row played last, before the start of the first row."""
        return float(self._recording.op[max(0, min(self._played, len(self._recording)) - 1)])

    @property
    def pv(self) -> float:
        """PV of the next row."""
        return float(self._recording.pv[min(self._played, len(self._recording) - 1)])

    def begin(self, commands: Commands) -> None:
        """Do nothing: commands do not change a recording."""

    def end(self) -> CycleRecord:
        """Return the next row."""
        recording = self._recording
        ended = self._played >= len(recording)
        row = min(self._played, len(recording) - 1)
        self._played += 1
        return CycleRecord(
            op=float(recording.op[row]),
            pv=float(recording.pv[row]),
            sp=math.nan if recording.sp is None else float(recording.sp[row]),
            stem=math.nan,
            automatic=not ended and (recording.auto is None or bool(recording.auto[row])),
            compensated=False,
        )

    def close(self) -> None:
        """Nothing to let go of."""
