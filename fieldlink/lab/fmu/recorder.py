"""What a run of an FMU leaves: a table of time and tags, as CSV, Parquet or a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError

__all__ = ["RunResult", "RunTable", "write_frame", "write_table"]


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
        failure: why it ended early; None when it did not.
        late: steps of a paced run that were not done by the next one's deadline.
        seconds: that the run took.
    """

    model: str
    time: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    inputs: tuple[str, ...]
    notes: tuple[str, ...]
    failure: str | None
    late: int
    seconds: float

    def frame(self) -> pd.DataFrame:
        """Return it as a table, time first."""
        return pd.DataFrame({"time": self.time, **self.columns})


class RunTable:
    """The outputs of every step as they come, by variable; the start is the first row."""

    def __init__(self, first: Mapping[str, float], count: int) -> None:
        self._values = {name: np.full(count + 1, np.nan) for name in first}
        self.rows = 0
        self.add(first)

    def add(self, outputs: Mapping[str, float]) -> None:
        """Add the outputs of one step."""
        for name, value in outputs.items():
            self._values[name][self.rows] = value
        self.last = outputs
        self.rows += 1

    def extend(self, outputs: Mapping[str, NDArray[np.float64]], count: int) -> None:
        """Add the outputs of ``count`` steps."""
        for name, values in outputs.items():
            self._values[name][self.rows : self.rows + count] = values
        self.rows += count

    def column(self, name: str) -> NDArray[np.float64]:
        """Return what was recorded of a variable."""
        return self._values[name][: self.rows]


def write_table(result: RunResult, file: Path) -> None:
    """Write a run; the ending of ``file`` says how: .csv or .parquet.

    Raises:
        FmuError: as `write_frame` says.
    """
    write_frame(result.frame(), file)


def write_frame(frame: pd.DataFrame, file: Path) -> None:
    """Write a table.

    Raises:
        FmuError: another ending, pyarrow is missing, or the file cannot be written.
    """
    try:
        if file.suffix == ".csv":
            frame.to_csv(file, index=False)
        elif file.suffix == ".parquet":
            frame.to_parquet(file, index=False)
        else:
            raise FmuError(f"{file}: name a file that ends in .csv or .parquet")
    except ImportError as error:
        raise FmuError(
            f"{file}: Parquet needs pyarrow; pip install 'fieldlink[parquet]', or name a .csv file"
        ) from error
    except OSError as error:
        raise FmuError(f"{file}: it cannot be written: {error}") from error
