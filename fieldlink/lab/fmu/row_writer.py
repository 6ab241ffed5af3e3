"""Put the rows of a run on the disk while it goes on."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.recorder import RunTable
from fieldlink.lab.fmu.run_settings import RunSettings
from fieldlink.lab.fmu.signals import Signals
from fmu_models import Plant

__all__ = ["RowWriter"]

Array = NDArray[np.float64]

_WRITE_SECONDS = 0.5
"""Of the wall clock, after which rows go to the disk: what a run that is killed loses."""


class RowWriter:
    """The rows of one run by tag, and how many of them are on the disk.

    Args:
        settings: which files are wanted.
        signals: what the tags are.
        driven: inputs by tag, a value for each step.
        table: the outputs as they come.
    """

    def __init__(
        self,
        settings: RunSettings,
        signals: Signals,
        driven: Mapping[str, Array],
        table: RunTable,
    ) -> None:
        self._settings, self._signals = settings, signals
        self._driven, self._table = driven, table
        self._written, self._written_at = 0, time.monotonic()
        self._began = False

    def columns(self, first: int, end: int) -> dict[str, Array]:
        """Return what is recorded in some rows, by tag.

        The input of the last row is the last that was given.
        """
        rows = np.arange(first, end)
        columns = {tag: v[np.minimum(rows, v.size - 1)] for tag, v in self._driven.items()}
        for tag, out in self._signals.outputs.items():
            values = self._table.column(out.variable)[first:end]
            columns[tag] = self._signals.to_tag(tag, values)
        return columns

    def write_some(self) -> None:
        """Write the rows so far to the disk; all but the last, whose inputs may still change."""
        if time.monotonic() > self._written_at + _WRITE_SECONDS:
            self._write_until(self._table.rows - 1)
            self._written_at = time.monotonic()

    def write_all(self) -> None:
        """Put the rest on the disk."""
        self._write_until(self._table.rows)

    def _write_until(self, end: int) -> None:
        if self._settings.table is not None and end > self._written:
            moments = self._table.time[self._written : end]
            self._settings.table.add(moments, self.columns(self._written, end))
            self._written = end

    def write_intermediate(self, plant: Plant) -> None:
        """Put the outputs between the ends of the steps so far on the disk, by variable.

        Raises:
            FmuError: the file cannot be written.
        """
        target = self._settings.intermediate
        if target is None:
            return
        piece = plant.take_intermediate()
        table = pd.DataFrame({"time": piece.time, **piece.columns})
        first = not self._began
        try:
            table.to_csv(target, index=False, header=first, mode="w" if first else "a")
        except OSError as error:
            raise FmuError(
                f"{target}: it cannot be written ({error.strerror}); "
                "check the folder and the free space"
            ) from error
        self._began = True
