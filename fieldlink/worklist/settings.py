"""The chosen numbers of the work list."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.facts import USUAL_OP_SPAN, span_of

__all__ = ["WorkListSettings"]


@dataclass(frozen=True, slots=True)
class WorkListSettings:
    """How a fleet is judged and ranked.

    Attributes:
        stick_band_limit: stick band, in % of OP's span, that maintenance should not let pass. Five
            times the 1 % that a new valve may have by EnTech's Control Valve Dynamic Specification
            (version 3.0, 1998, nominal class).
        op_span: OP's span, in units of OP, where no register map gives it; None for `span_of`.
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
    op_span: float | None = None
    recent: int = 6
    agreement: float = 0.8
    points: int = 40
    before: int = 20
    dead_band: float = 0.2
    picture_samples: int = 1500

    def span_of(self, op: NDArray[np.float64] | None = None) -> float:
        """Return the span of an OP that no register map describes, from its samples if given."""
        if self.op_span is not None:
            return self.op_span
        if op is None or not np.isfinite(op).any():
            return USUAL_OP_SPAN
        return span_of(op[~np.isnan(op)])
