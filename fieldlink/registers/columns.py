"""Many values through one tag at once: what a client reads back of each that a PLC stored."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldlink.registers.tag import Tag
from fieldlink.registers.types import DataType

__all__ = ["read_back"]


def read_back(tag: Tag, values: ArrayLike, held: float) -> NDArray[np.float64]:
    """Return what `Tag.decode` gives after a PLC stored each of ``values`` in turn.

    The same numbers as one value after the other through ``Tag.encode(value, clamp=True)``.

    Args:
        tag: of numbers; rounding, saturation and clamping are its own.
        values: engineering units, shape ``(n,)``. NaN goes into a float as it is; an integer has
            no such value and keeps what it held.
        held: what the registers hold before the first value, engineering units.

    Returns:
        Engineering values, shape ``(n,)``.

    Raises:
        RegisterValueError: the type cannot hold one of the values.
    """
    given = np.asarray(values, dtype=np.float64)
    raw = _stored(tag, given) if tag.bit is None else (given != 0.0).astype(np.float64)
    result: NDArray[np.float64] = tag.scale * raw + tag.offset
    if not tag.data_type.is_float:
        result = _hold(np.where(np.isnan(given), np.nan, result), held)
    if tag.clamp:
        low = -np.inf if tag.low is None else tag.low
        high = np.inf if tag.high is None else tag.high
        infinite = np.isinf(result)
        result = np.where(infinite, result, np.clip(result, low, high))
    return result


def _stored(tag: Tag, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the raw numbers that the registers hold."""
    kind = tag.data_type
    smallest, largest = kind.bounds
    raw = (values - tag.offset) / tag.scale
    raw = np.where(np.isfinite(raw), np.clip(raw, smallest, largest), raw)
    if kind is DataType.FLOAT64:
        return raw
    if kind is DataType.FLOAT32:
        return raw.astype(np.float32).astype(np.float64)
    doubtful = np.isinf(raw)
    if kind is DataType.BOOL:
        doubtful |= ~np.isnan(raw) & (raw != 0.0) & (raw != 1.0)
    if doubtful.any():
        tag.encode(float(values[doubtful][0]), clamp=True)  # refuses it, in its own words
    return np.rint(raw)


def _hold(values: NDArray[np.float64], held: float) -> NDArray[np.float64]:
    """Return ``values`` with each NaN replaced by the number before it."""
    missing = np.isnan(values)
    if not missing.any():
        return values
    known = np.concatenate(([held], values))
    last = np.maximum.accumulate(np.where(np.concatenate(([False], missing)), 0, range(known.size)))
    return known[last][1:]
