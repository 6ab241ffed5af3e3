"""How much the sticking does, beside how sure it is."""

from __future__ import annotations

import numpy as np

from estimator.algebra import dot
from estimator.hypotheses.hypothesis import Case, Hypothesis

__all__ = ["effect_of"]


def effect_of(case: Case, sticky: Hypothesis) -> float:
    """Share of PV's variance that the difference between stem and OP makes through the process."""
    difference = sticky.stem - case.rows.u
    made = sticky.gain * sticky.poles.response(difference)
    judged = case.rows.weight
    count = float(judged.sum())
    mean = float(dot(made, judged)) / count
    centred = (made - mean) * judged
    return float(dot(centred, centred)) / count / max(float(np.var(case.rows.y)), 1e-12)
