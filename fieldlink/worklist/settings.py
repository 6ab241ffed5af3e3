"""The chosen numbers of the work list."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["WorkListSettings"]


@dataclass(frozen=True, slots=True)
class WorkListSettings:
    """How a fleet is judged and ranked.

    Attributes:
        stick_band_limit: stick band, in % of OP's span, that maintenance should not let pass. Five
            times the 1 % that a new valve may have by EnTech's Control Valve Dynamic Specification
            (version 3.0, 1998, nominal class).
        op_span: OP's span, in units of OP, where neither register map nor user gives it: most
            controllers put out 0 to 100 %.
        recent: newest judged windows whose verdicts are compared; with six, one that disagrees
            still leaves a clear majority.
        agreement: share of them from which confidence is high.
        points: most points of a course; estimates of a long history are combined to so many,
            because a picture of a page's width shows no more, and a trend of 40 points has the
            precision of all.
        before: windows before a repair that are compared with those after it.
        dead_band: turns of OP by less, in % of its span, are noise that no positioner follows.
        picture_samples: most samples in a picture.
    """

    stick_band_limit: float = 5.0
    op_span: float = 100.0
    recent: int = 6
    agreement: float = 0.8
    points: int = 40
    before: int = 20
    dead_band: float = 0.2
    picture_samples: int = 1500
