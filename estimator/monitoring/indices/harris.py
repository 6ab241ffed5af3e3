"""Harris index: how near is the control error to the least variance that can be reached?"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estimator.monitoring.indices._signals import vector
from estimator.outcomes import EstimatorError

__all__ = ["harris_index"]


def harris_index(error: ArrayLike, *, dead_time: int, order: int = 20) -> float:
    """Minimum variance over actual variance of the control error, from routine data alone.

    The error is regressed on its own past from ``dead_time`` samples back; what remains is what no
    controller could have prevented.

    Args:
        error: PV minus SP, or PV at a constant SP, shape ``(n,)``, NaN where bad; its mean is
            taken off.
        dead_time: samples from OP to PV, 1 or more (1 is a sampled process without extra delay).
        order: past values in the regression.

    Returns:
        1 for minimum variance, towards 0 for a loop that could be much better; NaN for a constant
        error.

    Raises:
        EstimatorError: dead time or order below 1, or too few usable samples.

    Source: Harris (1989), "Assessment of control loop performance", Can. J. Chem. Eng. 67, 856-861;
    regression: Desborough and Harris (1992), Can. J. Chem. Eng. 70, 1186-1197.
    """
    if dead_time < 1 or order < 1:
        raise EstimatorError(
            f"dead_time and order must be 1 or more; got dead_time={dead_time}, order={order}"
        )
    values = vector("error", error)
    values = values - np.nanmean(values)
    first = dead_time + order - 1
    past = np.column_stack(
        [values[first - dead_time - i : values.size - dead_time - i] for i in range(order)]
    )
    target = values[first:]
    whole = np.isfinite(past).all(axis=1) & np.isfinite(target)
    rows = int(whole.sum())
    if rows < 3 * order:
        raise EstimatorError(
            f"a regression of order {order} needs {3 * order} complete rows, the signal gives "
            f"{rows}; take a longer window or a lower order"
        )
    past, target = past[whole], target[whole]
    total = float(target @ target) / rows
    if total <= 1e-24 * max(1.0, float(np.nanmax(np.abs(np.asarray(error, dtype=float))))) ** 2:
        return float("nan")
    rest = target - past @ np.linalg.lstsq(past, target, rcond=None)[0]
    return min(1.0, float(rest @ rest) / (rows - order) / total)
