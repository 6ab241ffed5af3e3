"""Recorded inputs: a CSV file with a column ``time`` and one column for each tag or variable."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError, nearest

__all__ = ["InputSeries", "read_inputs"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InputSeries:
    """Values that hold from their moment on; before the first moment the first value holds.

    Attributes:
        time: seconds of the experiment, increasing, shape ``(n,)``.
        columns: values by tag, each of shape ``(n,)``.
    """

    time: Array
    columns: Mapping[str, Array]

    def at(self, moments: Array) -> dict[str, Array]:
        """Return every column at ``moments``."""
        # A moment that is late by rounding only takes the value that begins there.
        slack = 1e-9 * np.maximum(1.0, np.abs(moments))
        rows = np.searchsorted(self.time, moments + slack, side="right") - 1
        return {name: values[np.maximum(rows, 0)] for name, values in self.columns.items()}


def read_inputs(file: Path, known: Iterable[str]) -> InputSeries:
    """Read the inputs of an experiment.

    Args:
        file: CSV with a header; any delimiter that pandas finds.
        known: names that a column may have.

    Raises:
        FmuError: unreadable, no column ``time``, an unknown column, a cell that is no number, or
            time that does not increase; row and column are named.
    """
    try:
        frame = pd.read_csv(file, sep=None, engine="python", skipinitialspace=True)
    except (OSError, ValueError, csv.Error) as error:
        raise FmuError(f"{file}: the inputs cannot be read: {error}") from error
    frame.columns = [str(name).strip() for name in frame.columns]
    if "time" not in frame.columns:
        raise FmuError(
            f"{file}: there is no column 'time' (seconds of the experiment); the columns are "
            f"{', '.join(frame.columns)}"
        )
    names = set(known)
    columns: dict[str, Array] = {}
    for name in frame.columns:
        if name != "time" and name not in names:
            raise FmuError(f"{file}: column {name!r} is no input; {nearest(name, names)}")
        columns[name] = _numbers(file, name, frame[name])
    time = columns.pop("time")
    if time.size == 0:
        raise FmuError(f"{file}: there is no row below the header")
    wrong = np.flatnonzero(np.diff(time) <= 0.0)
    if wrong.size:
        row = int(wrong[0])
        raise FmuError(
            f"{file}: time must increase; row {row + 3} has {time[row + 1]:g} after {time[row]:g}"
        )
    return InputSeries(time, columns)


def _numbers(file: Path, name: str, column: pd.Series) -> Array:
    values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        row = int(wrong[0])
        raise FmuError(
            f"{file}: row {row + 2}, column {name!r}: {column.iloc[row]!r} is no finite number"
        )
    return values
