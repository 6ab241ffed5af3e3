"""A plant in this process: fast, and a crash of the FMU takes the process with it."""

from __future__ import annotations

import functools
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import ArrayLike, NDArray

from .columns import changed_rows, count_finite_rows, split_columns
from .condition import PlantCondition
from .errors import (
    PlantClosedError,
    PlantInputError,
    PlantStepError,
)
from .instances import EndedError, Instance, StoppedError
from .library import forget_words, is_fatal, last_words
from .opening import OpenOptions, load_fmu
from .pieces import PIECE_SECONDS, fill_pieces
from .plant import Piece, Plant, PlantInfo
from .snapshots import pack_snapshot, unpack_snapshot
from .start_values import StartValues, write_texts

__all__ = ["InProcessPlant"]


class InProcessPlant(Plant):
    """An FMU instance of this process, started and at rest.

    Args:
        file: the ``.fmu``.
        options: how to open it.
        folder: where to extract; None makes a temporary folder that `close` removes.

    Raises:
        PlantError: what `open_plant` says.
    """

    def __init__(self, file: Path, options: OpenOptions, folder: Path | None = None) -> None:
        self._count = 0
        loaded = load_fmu(file, options, folder)
        self._info, self._variables, self._base = loaded.info, loaded.variables, loaded.start_time
        self._period = self._info.period
        self._condition = PlantCondition(self._info.name)
        self._folder, self._log = loaded.folder, loaded.intermediate
        self._instance: Instance | None = loaded.instance
        try:
            self._begin(loaded.instance, loaded.starts)
        except BaseException:
            self.close()
            raise

    def _begin(self, instance: Instance, starts: StartValues) -> None:
        fmu, variables = instance.fmu, self._variables

        def write() -> None:
            variables.write(fmu, starts.numbers, before_start=True)
            write_texts(fmu, instance.version, starts.texts)

        try:
            if starts.structural:
                instance.configure(lambda: variables.write_structural(fmu, starts.structural))
            instance.start(write, self._base)
        except (FMICallException, StoppedError, EndedError) as error:
            raise self._condition.refuse_start(error) from error
        try:
            self._outputs = self._variables.read_outputs(instance.fmu, self._base)
        except FMICallException as error:
            raise self._condition.refuse_reading(error, self._info.outputs) from error

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._info

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self._base + self._count * self._period

    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time."""
        self._alive()
        return dict(self._outputs)

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs, advance one period, return all outputs."""
        instance = self._alive()
        forget_words()
        if inputs:
            self._write(instance, inputs)
        try:
            instance.advance(self._base + self._count * self._period, self._period)
            self._count += 1
            now = self._base + self._count * self._period
            self._outputs = self._variables.read_outputs(instance.fmu, now)
        except EndedError as error:
            self._go_to(error.reached)
            raise self._condition.end(error) from error
        except (FMICallException, StoppedError) as error:
            raise self._condition.refuse_step(error, self.time, self._period) from error
        except PlantStepError as error:
            self._condition.fail(str(error))
            raise
        return self._outputs.copy()

    def _write(self, instance: Instance, inputs: Mapping[str, float]) -> None:
        try:
            instance.change(lambda: self._variables.write(instance.fmu, inputs, before_start=False))
        except EndedError as error:
            raise self._condition.end(error) from error
        except StoppedError as error:
            raise self._condition.refuse_step(error, self.time, self._period) from error
        except FMICallException as error:
            if is_fatal(error):
                raise self._condition.refuse_step(error, self.time, self._period) from error
            given = ", ".join(f"{name} = {float(value):g}" for name, value in inputs.items())
            raise PlantInputError(
                f"plant {self._info.name} at {self.time:g} s does not take {given}{last_words()}"
            ) from error

    def _go_to(self, moment: float) -> None:
        """Take ``moment`` for the present time, from which periods are counted on."""
        if moment > self.time:
            self._base, self._count = moment, 0

    def run_pieces(
        self, count: int, inputs: Mapping[str, ArrayLike], *, last: float | None = None
    ) -> Iterator[Piece]:
        """Step ``count`` times; see `Plant.run_pieces`."""
        return fill_pieces(self.fill, self._info.outputs, count, inputs, last)

    def fill(
        self,
        inputs: Mapping[str, ArrayLike],
        table: NDArray[np.float64],
        moments: NDArray[np.float64],
        progress: NDArray[np.int64],
        *,
        last: float | None = None,
        seconds: float = math.inf,
    ) -> None:
        """Step once for each row of ``table`` and put outputs and time there.

        Args:
            inputs: by name, a number or an array with a value for each row.
            table: shape ``(rows, outputs)``.
            moments: shape ``(rows,)``.
            progress: ``progress[0]`` counts the rows that are done, failure or not.
            last: seconds of the last row's step, where it is shorter than the period.
            seconds: of the wall clock, after which no further step is begun.

        Raises:
            PlantError: as `step` does.
        """
        progress[0] = 0
        instance = self._alive()
        count = len(table)
        held, columns = split_columns(count, inputs)
        forget_words()
        if held:
            self._write(instance, held)
        variables, fmu, period = self._variables, instance.fmu, self._period
        write = variables.column_writer(columns)
        changes = changed_rows(count, columns)
        begun = looked = perf_counter()
        try:
            for k in range(count):
                if changes[k]:
                    self._change_row(instance, functools.partial(write, fmu, k))
                if last is not None and k == count - 1:
                    instance.advance(self.time, last)
                    self._go_to(self.time + last)
                else:
                    instance.advance(self._base + self._count * period, period)
                    self._count += 1
                variables.read_row(fmu, table[k])
                moments[k] = self._base + self._count * period
                progress[0] = k + 1
                now = perf_counter()
                if now - looked > PIECE_SECONDS:
                    looked = now
                    if count_finite_rows(table[: k + 1]) <= k or now - begun > seconds:
                        break
        except EndedError as error:
            if error.reached > self.time + 1e-9 * period:
                self._go_to(error.reached)
                variables.read_row(fmu, table[k])
                moments[k] = self.time
                progress[0] = k + 1
            self._check_rows(table, moments, progress)
            raise self._condition.end(error) from error
        except (FMICallException, StoppedError) as error:
            self._check_rows(table, moments, progress)
            raise self._condition.refuse_step(error, self.time, self._period) from error
        self._check_rows(table, moments, progress)
        if progress[0]:
            row = table[int(progress[0]) - 1].tolist()
            self._outputs = dict(zip(self._info.outputs, row, strict=True))

    def _change_row(self, instance: Instance, write: functools.partial[None]) -> None:
        try:
            instance.change(write)
        except FMICallException as error:
            if is_fatal(error):
                raise
            raise PlantInputError(
                f"plant {self._info.name} at {self.time:g} s does not take its inputs{last_words()}"
            ) from error

    def _check_rows(
        self,
        table: NDArray[np.float64],
        moments: NDArray[np.float64],
        progress: NDArray[np.int64],
    ) -> None:
        """Cut the rows before the first NaN or infinity, and fail where there is one."""
        done = int(progress[0])
        row = count_finite_rows(table[:done])
        if row == done:
            return
        progress[0] = row
        column = int(np.argmin(np.isfinite(table[row])))
        name = self._info.outputs[column]
        raise self._condition.fail(
            self._variables.not_finite(name, table[row, column], float(moments[row]))
        )

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs``."""
        return [self.step(values) for values in inputs]

    def take_intermediate(self) -> Piece:
        """Return the outputs between the ends of steps since this was called last."""
        if self._log is None:
            return super().take_intermediate()
        return self._log.take()

    def snapshot(self) -> bytes:
        """Return the plant's whole state."""
        instance = self._alive()
        self._check_can_restore()
        forget_words()
        try:
            content = instance.save()
        except FMICallException as error:
            raise PlantStepError(
                f"plant {self._info.name} could not save its state: {error}{last_words()}"
            ) from error
        return pack_snapshot(self._count, self._base, self._period, content)

    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned."""
        instance = self._opened()
        self._check_can_restore()
        count, base, state = unpack_snapshot(self._info.name, self._period, snapshot)
        forget_words()
        try:
            instance.restore(state)
        except (FMICallException, struct.error) as error:
            raise PlantInputError(
                f"plant {self._info.name} cannot restore this snapshot{last_words()}"
            ) from error
        self._count, self._base = count, base
        self._condition.revive()
        self._variables.refresh(instance.fmu)
        self._outputs = self._variables.read_outputs(instance.fmu, self.time)

    def _check_can_restore(self) -> None:
        if not self._info.can_restore:
            raise PlantStepError(
                f"plant {self._info.name}: its FMU offers no serialised state, so no snapshot"
            )

    def _alive(self) -> Instance:
        self._condition.check_alive()
        return self._opened()

    def _opened(self) -> Instance:
        self._condition.check_callable()
        if self._instance is None:
            raise PlantClosedError(f"plant {self._info.name} is closed; open it again")
        return self._instance

    def close(self) -> None:
        """End the instance, unload the library and remove the temporary folder."""
        instance, self._instance = self._instance, None
        # After a fatal status not even freeing the instance is allowed: it is left as it is.
        if instance is not None and not self._condition.fatal:
            instance.close(healthy=self._condition.healthy)
        if self._folder is not None:
            self._folder.cleanup()
