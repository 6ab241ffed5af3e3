"""What a valve does in a day: how far it travels and how often it turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled import kernel
from estimator.monitoring.indices._signals import vector
from estimator.outcomes import EstimatorError

__all__ = ["ValveWear", "travel_and_turns", "valve_wear"]

_DAY = 86400.0


@dataclass(frozen=True, slots=True)
class ValveWear:
    """Travel in units of the signal per day, and changes of direction per day."""

    travel_per_day: float
    reversals_per_day: float


@kernel
def travel_and_turns(position: NDArray[np.float64], deadband: float) -> tuple[float, int]:
    """Way of a signal ``(n,)``, and its turns; one back by at most ``deadband`` is noise."""
    travel, reversals = 0.0, 0
    anchor, direction = position[0], 0.0
    for value in position[1:]:
        move = value - anchor
        if abs(move) <= deadband and move * direction <= 0.0:
            continue
        if move == 0.0:
            continue
        travel += abs(move)
        anchor = value
        if move * direction < 0.0:
            reversals += 1
        direction = np.sign(move)
    return travel, reversals


def valve_wear(position: ArrayLike, *, period: float, deadband: float = 0.0) -> ValveWear:
    """Travel and reversals a day of a stem (estimated or measured), or of OP.

    Args:
        position: samples, shape ``(n,)``, NaN where bad; the day is that of all samples.
        period: seconds between samples.
        deadband: a turn back by no more than this is noise and counts for neither figure, in
            units of the signal.

    Raises:
        EstimatorError: too few usable samples, or a period or dead band out of range.

    Source: the count that ISA-TR75.25.02 and positioner diagnostics give; travel and reversals are
    what wears a packing.
    """
    if not period > 0.0 or deadband < 0.0:
        raise EstimatorError(
            f"period must be positive and deadband not negative; got {period!r} and {deadband!r}"
        )
    values = vector("position", position)
    travel, reversals = travel_and_turns(values[np.isfinite(values)], float(deadband))
    days = values.size * period / _DAY
    return ValveWear(float(travel) / days, float(reversals) / days)
