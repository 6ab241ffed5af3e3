"""Columns that go into a run, one value a step, and rows that come out of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import PlantInputError

__all__ = ["changed_rows", "count_finite_rows", "split_columns"]


def split_columns(
    count: int, inputs: Mapping[str, ArrayLike]
) -> tuple[dict[str, float], dict[str, NDArray[np.float64]]]:
    """Return the numbers and the arrays among ``inputs``.

    Raises:
        PlantInputError: an array of another length, or a count below zero.
    """
    if count < 0:
        raise PlantInputError(f"the number of steps must not be negative; got {count}")
    held: dict[str, float] = {}
    columns: dict[str, NDArray[np.float64]] = {}
    for name, given in inputs.items():
        values = np.asarray(given, dtype=np.float64)
        if values.ndim == 0:
            held[name] = float(values)
        elif values.shape == (count,):
            columns[name] = np.ascontiguousarray(values)
        else:
            raise PlantInputError(
                f"{name} has the shape {values.shape}; give a number or an array ({count},), one "
                "value a step"
            )
    return held, columns


def count_finite_rows(table: NDArray[np.float64]) -> int:
    """Return how many rows stand before the first that has NaN or infinity."""
    finite = np.isfinite(table)
    if finite.all():
        return len(table)
    return int(np.argmin(finite.all(axis=1)))


def changed_rows(count: int, columns: Mapping[str, NDArray[np.float64]]) -> list[bool]:
    """Return for each row whether an input differs from the row before; the first always does.

    An input that keeps its value is not written again: to a model with events that is an event.
    """
    changed = np.zeros(count, dtype=bool)
    for values in columns.values():
        changed[1:] |= values[1:] != values[:-1]
    if columns and count:
        changed[0] = True
    result: list[bool] = changed.tolist()
    return result
