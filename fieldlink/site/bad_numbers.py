"""Numbers that stand for no measurement: -9999, 32767 and the like, as exports write bad samples.

    values = np.array([51.2, -9999.0, 51.3])
    drop_bad_numbers({"op": values})    # ["op: -9999 at 1 row, far from ..."]; values[1] is NaN

Such a number may also be measured, so that it counts as one unless it is far from all others.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["drop_bad_numbers"]

NINES = tuple(sign * float("9" * digits) for digits in (3, 4, 5, 6) for sign in (-1.0, 1.0))
"""What people write for "no value"."""

ENDS_OF_TYPES = (-32768.0, 32767.0, 65535.0, -(2.0**31), 2.0**31 - 1.0, 2.0**32 - 1.0)
"""What integers of 16 and 32 bits hold when a value is bad or beyond them."""

FAR = 5.0
"""Ranges of all other samples by which a bad number lies outside them: -999 beside 0 to 100 % is
nine away, and no loop goes there and back between two samples."""

LEAST_RANGE = 0.2
"""Share of the samples' size that their range counts as at least: a constant 900 may become 999."""


def drop_bad_numbers(numbers: Mapping[str, NDArray[np.float64] | None]) -> list[str]:
    """Make samples NaN whose number stands for none; return a note for each such number.

    Args:
        numbers: values by role, ``(n,)`` each, changed in place.
    """
    notes = []
    ranges = {role: _range_of(values) for role, values in numbers.items() if values is not None}
    for role, values in numbers.items():
        if values is None or (own := ranges[role]) is None:
            continue
        low, high = own
        if role == "sp" and (of_pv := ranges.get("pv")) is not None:
            # A set-point of 999 is one where PV follows it.
            low, high = min(low, of_pv[0]), max(high, of_pv[1])
        span = max(high - low, LEAST_RANGE * abs(low), LEAST_RANGE * abs(high))
        for bad in (*NINES, *ENDS_OF_TYPES):
            at = values == bad
            if at.any() and max(low - bad, bad - high) > FAR * span:
                values[at] = np.nan
                rows = "1 row" if at.sum() == 1 else f"{at.sum()} rows"
                notes.append(
                    f"{role}: {bad:.10g} at {rows}, far from the others ({low:g} to {high:g}), is "
                    "taken for bad samples"
                )
    return notes


def _range_of(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """The least and the largest of the samples that no such number is; None where there is none."""
    usual = values[np.isfinite(values) & ~np.isin(values, (*NINES, *ENDS_OF_TYPES))]
    return (float(usual.min()), float(usual.max())) if usual.size else None
