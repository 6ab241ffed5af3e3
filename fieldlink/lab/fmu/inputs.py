"""Recorded inputs: a CSV file with a column ``time`` and one column for each tag or variable."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.lab.fmu.recorder import TIME_VARIABLE

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


_NO_WORDS: Mapping[str, Mapping[str, float]] = MappingProxyType({})


def read_inputs(
    file: Path, known: Iterable[str], words: Mapping[str, Mapping[str, float]] = _NO_WORDS
) -> InputSeries:
    """Read the inputs of an experiment.

    Args:
        file: CSV with a header; any delimiter that pandas finds.
        known: names that a column may have.
        words: by column, the words that stand for values, such as those of an enumeration.

    Raises:
        FmuError: unreadable, no column ``time``, an unknown column, a cell that is not a number, or
            time that does not increase; row and column are named.
    """
    try:
        frame = pd.read_csv(file, sep=None, engine="python", skipinitialspace=True, dtype=str)
    except (OSError, ValueError, csv.Error) as error:
        raise FmuError(f"{file}: the inputs cannot be read: {error}") from error
    frame.columns = [str(name).strip() for name in frame.columns]
    if "time" not in frame.columns:
        raise FmuError(
            f"{file}: there is no column 'time' (seconds of the experiment); the columns are "
            f"{', '.join(frame.columns)}"
        )
    names = {TIME_VARIABLE if name == "time" else name for name in known}
    columns: dict[str, Array] = {}
    time = _numbers(file, "time", frame.pop("time"), {})
    for name in frame.columns:
        if name not in names:
            raise FmuError(f"{file}: column {name!r} is no input; {nearest(name, names)}")
        tag = "time" if name == TIME_VARIABLE else name
        columns[tag] = _numbers(file, name, frame[name], words.get(tag, {}))
    if time.size == 0:
        raise FmuError(f"{file}: there is no row below the header")
    wrong = np.flatnonzero(np.diff(time) <= 0.0)
    if wrong.size:
        row = int(wrong[0])
        raise FmuError(
            f"{file}: time must increase; row {row + 3} has {time[row + 1]:g} after {time[row]:g}"
        )
    return InputSeries(time, columns)


def _numbers(file: Path, name: str, column: pd.Series, words: Mapping[str, float]) -> Array:
    plain = {word.lower(): number for word, number in words.items()}
    texts = [text.strip() if isinstance(text, str) else "" for text in column]
    known = pd.Series([plain.get(text.lower(), text) for text in texts], dtype=object)
    values = pd.to_numeric(known, errors="coerce").to_numpy(dtype=np.float64)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        row = int(wrong[0])
        found = repr(texts[row]) if texts[row] else "an empty cell"
        hint = f" and none of {', '.join(words)}" if words else ""
        raise FmuError(f"{file}: row {row + 2}, column {name!r}: {found} is no finite number{hint}")
    return values
