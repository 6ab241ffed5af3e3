"""What a run of an FMU leaves: a table of time and tags, as CSV, Parquet or a picture.

The table grows on disk while the run goes on (`TableFile`), so that a run that is killed has left
what it computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError
from fmu_models import Piece, StartValue

__all__ = ["TIME_VARIABLE", "RunResult", "RunTable", "TableFile", "check_ending", "write_frame"]

Array = NDArray[np.float64]

TIME_VARIABLE = "variable.time"
"""The column of a variable that is itself called ``time``; the column ``time`` is the moment."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """A run.

    Attributes:
        model: the model's name.
        time: seconds, shape ``(n,)``; the first row is the state at the start.
        columns: every input and output by tag, in the order to show, each ``(n,)``. The value of an
            input in a row is the one that was applied from that row's moment on.
        units: by tag, empty where unknown.
        inputs: the tags that were written.
        notes: what the user should know.
        ended: in which words the FMU ended the simulation before the stop time; None when it did
            not.
        failure: why it failed before the stop time; None when it did not.
        late: steps of a paced run that were not done by the next one's deadline.
        seconds: that the run took.
        start_values: that the FMU was given, by variable, in its own unit.
        step: seconds.
    """

    model: str
    time: Array
    columns: dict[str, Array]
    units: dict[str, str]
    inputs: tuple[str, ...]
    notes: tuple[str, ...]
    ended: str | None
    failure: str | None
    late: int
    seconds: float
    start_values: Mapping[str, StartValue]
    step: float

    def frame(self) -> pd.DataFrame:
        """Return it as a table, time first."""
        return _frame(self.time, self.columns)


def _frame(time: Array, columns: Mapping[str, Array]) -> pd.DataFrame:
    named = {TIME_VARIABLE if tag == "time" else tag: v for tag, v in columns.items()}
    return pd.DataFrame({"time": time, **named})


class RunTable:
    """The outputs of every step as they come, by variable; the start is the first row."""

    def __init__(self, start: float, first: Mapping[str, float], count: int) -> None:
        self.time = np.full(count + 1, np.nan)
        self._values = {name: np.full(count + 1, np.nan) for name in first}
        self.rows = 0
        self.add(start, first)

    def add(self, moment: float, outputs: Mapping[str, float]) -> None:
        """Add the outputs of one step."""
        self.time[self.rows] = moment
        for name, value in outputs.items():
            self._values[name][self.rows] = value
        self.last = outputs
        self.rows += 1

    def extend(self, piece: Piece) -> None:
        """Add the outputs of some steps."""
        end = self.rows + piece.time.size
        self.time[self.rows : end] = piece.time
        for name, values in piece.columns.items():
            self._values[name][self.rows : end] = values
        self.last = {name: float(values[-1]) for name, values in piece.columns.items()}
        self.rows = end

    def column(self, name: str) -> Array:
        """Return what was recorded of a variable."""
        return self._values[name][: self.rows]


class TableFile:
    """A table that grows on disk, row by row.

    A ``.csv`` file is written as it goes. Parquet has its directory at its end: the rows go into
    ``FILE.partial.csv`` first, and `finish` writes the table and removes that file.

    Args:
        file: ends in .csv or .parquet.

    Raises:
        FmuError: another ending, or the file cannot be written.
    """

    def __init__(self, file: Path) -> None:
        check_ending(file)
        self.file = file
        direct = file.suffix == ".csv"
        self.growing = file if direct else file.with_name(f"{file.name}.partial.csv")
        self._stream: TextIO | None = None

    def add(self, time: Array, columns: Mapping[str, Array]) -> None:
        """Append rows; the columns are the same in every call.

        Raises:
            FmuError: the file cannot be written.
        """
        first = self._stream is None
        try:
            if self._stream is None:
                self._stream = self.growing.open("w", encoding="utf-8", newline="")
            frame = _frame(time, columns)
            frame.to_csv(self._stream, index=False, header=first, lineterminator="\n")
            self._stream.flush()
        except OSError as error:
            raise FmuError(
                f"{self.growing}: it cannot be written ({error.strerror}); "
                "check the folder and the free space"
            ) from error

    def finish(self, result: RunResult) -> None:
        """Close the file; write the Parquet table, where that is wanted.

        Raises:
            FmuError: as `write_frame` says; the growing file stays then.
        """
        self.close()
        if self.growing != self.file:
            write_frame(result.frame(), self.file)
            self.growing.unlink()

    def close(self) -> None:
        """Close the growing file; more than once does no harm."""
        if self._stream is not None:
            self._stream.close()


def check_ending(file: Path) -> None:
    """Refuse a file that is neither CSV nor Parquet.

    Raises:
        FmuError: the ending is another one.
    """
    if file.suffix not in (".csv", ".parquet"):
        raise FmuError(f"{file}: name a file that ends in .csv or .parquet")


def write_frame(frame: pd.DataFrame, file: Path) -> None:
    """Write a table.

    Raises:
        FmuError: another ending, pyarrow is missing, or the file cannot be written.
    """
    check_ending(file)
    try:
        if file.suffix == ".csv":
            frame.to_csv(file, index=False)
        else:
            frame.to_parquet(file, index=False)
    except ImportError as error:
        raise FmuError(
            f"{file}: Parquet needs pyarrow; pip install 'fieldlink[parquet]', or name a .csv file"
        ) from error
    except OSError as error:
        raise FmuError(
            f"{file}: it cannot be written ({error.strerror or error}); "
            "check the folder and the free space"
        ) from error
