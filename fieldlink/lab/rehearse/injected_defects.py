"""Defects that can be put into a rehearsal, to see that it turns red.

A rehearsal that cannot fail proves nothing. Each defect breaks one thing on purpose, in the scene
or in the product; `fieldlink rehearse SCENARIO --inject DEFECT` runs with it, and a scenario file
names the ones that must make it fail.
"""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Defect"]


class Defect(StrEnum):
    """What is broken; `text` says it in words."""

    STICKY_VALVE = "sticky-valve"
    HEALTHY_VALVE = "healthy-valve"
    NO_REPAIR = "no-repair"
    ALWAYS_STICTION = "always-stiction"
    NEVER_STICTION = "never-stiction"
    NEVER_UNSURE = "never-unsure"
    WRONG_SCALE = "wrong-scale"
    LOST_BLOCKS = "lost-blocks"
    DAMAGED_BLOCKS = "damaged-blocks"
    TORN_BLOCKS = "torn-blocks"
    WRONG_SIGN = "wrong-sign"
    NO_COMPENSATION = "no-compensation"
    NO_FALL_BACK = "no-fall-back"
    CLOSED_GAPS = "closed-gaps"
    HEARTBEAT_WITH_POLLS = "heartbeat-with-polls"

    @property
    def text(self) -> str:
        """What it does."""
        return _TEXTS[self]


_TEXTS = {
    Defect.STICKY_VALVE: "the valve sticks (S = 6, J = 2) whatever the scenario says",
    Defect.HEALTHY_VALVE: "the valve is healthy whatever the scenario says",
    Defect.NO_REPAIR: "the repair is not done",
    Defect.ALWAYS_STICTION: "every window that can be judged is called stiction",
    Defect.NEVER_STICTION: "every window that can be judged is called healthy",
    Defect.NEVER_UNSURE: "windows that cannot be judged are called healthy",
    Defect.WRONG_SCALE: "S and J are reported half as large again",
    Defect.LOST_BLOCKS: "the PLC never sees the commit of a block",
    Defect.DAMAGED_BLOCKS: "a bit of every block changes on its way to the PLC",
    Defect.TORN_BLOCKS: "only the first half of every block arrives at the PLC",
    Defect.WRONG_SIGN: "every model has the process gain with the wrong sign",
    Defect.NO_COMPENSATION: "the PLC takes blocks over but never compensates",
    Defect.NO_FALL_BACK: "the PLC never notices that compensation makes the loop worse",
    Defect.HEARTBEAT_WITH_POLLS: "the heartbeat goes out with the polls only",
    Defect.CLOSED_GAPS: "samples that were missed leave no gap: the next take their places",
}
