"""What the indices that practitioners know say of the labelled windows, beside the score.

Each is turned into one number that is larger for a sticky valve, as its source reads it: Horch's
cross-correlation odd, the ellipse of PV over OP wide, the control error far from minimum variance,
the oscillation regular. A window in which an index has no answer counts as its lowest value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.recorded import Judged, Labelled
from benchmarks.report import table
from benchmarks.roc import auc
from estimator.monitoring.indices import apparent_stiction, cross_correlation, harris_index, oscillation
from estimator.outcomes import EstimatorError

__all__ = ["companions"]

_DEAD_TIME = 3
"""Samples that the Harris index takes for the dead time: nobody has told it the plant's."""


def _error(window: Labelled) -> np.ndarray:
    """Control error; PV about its mean where the set-point is not recorded."""
    return window.pv - (np.nanmean(window.pv) if window.sp is None else window.sp)


def _horch(window: Labelled) -> float:
    return cross_correlation(window.op, window.pv).height_asymmetry


def _ellipse(window: Labelled) -> float:
    width = apparent_stiction(window.op, window.pv).apparent_stiction
    deviation = float(np.nanstd(window.op))
    return width / deviation if deviation > 0.0 else math.nan


def _regularity(window: Labelled) -> float:
    return oscillation(_error(window)).regularity


def _harris(window: Labelled) -> float:
    return 1.0 - harris_index(_error(window), dead_time=_DEAD_TIME)


_INDICES: dict[str, Callable[[Labelled], float]] = {
    "Horch, asymmetry of the cross-correlation": _horch,
    "apparent stiction over OP's deviation": _ellipse,
    "regularity of the oscillation": _regularity,
    "1 less the Harris index": _harris,
}


def _value(index: Callable[[Labelled], float], window: Labelled) -> float:
    try:
        found = index(window)
    except EstimatorError:
        return -math.inf
    return -math.inf if math.isnan(found) else found


def companions(plant: Sequence[Judged], isdb: Sequence[Judged]) -> tuple[str, dict[str, Any]]:
    """Area under the ROC of each index and of the score over the windows; plain types too."""
    groups = {"plant": plant, "ISDB": isdb, "both": [*plant, *isdb]}
    header = ("figure", *(f"AUC, {name}" for name in groups), "no answer")
    rows: list[tuple[Any, ...]] = []
    every = groups["both"]
    for name, index in _INDICES.items():
        values = {id(one): _value(index, one.window) for one in every}
        areas = [
            auc([values[id(one)] for one in group], [one.is_sticky for one in group])
            for group in groups.values()
        ]
        rows.append((name, *areas, sum(math.isinf(v) and v < 0.0 for v in values.values())))
    areas = [
        auc([one.result.score for one in group], [one.is_sticky for one in group])
        for group in groups.values()
    ]
    rows.append(("score of this estimator", *areas, 0))
    return (
        f"## Indices that practitioners know, on the same windows\n\n{table(header, rows)}",
        {"companions": [dict(zip(header, row, strict=True)) for row in rows]},
    )
