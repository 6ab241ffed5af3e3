"""A plant in this process: fast, and a crash of the FMU takes the process with it."""

from __future__ import annotations

import functools
import struct
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import ArrayLike, NDArray

from .archive import extract_fmu, read_description
from .errors import (
    PlantClosedError,
    PlantError,
    PlantInputError,
    PlantStepError,
)
from .instances import CoSimulation, Instance, StoppedError, forget_words, last_words, load
from .model_exchange import ModelExchange
from .plant import Plant, PlantInfo, split_columns
from .variables import VariableAccess

__all__ = ["InProcessPlant"]

_SNAPSHOT_HEAD = struct.Struct("<4sqd")
_SNAPSHOT_MARK = b"FLP1"


class InProcessPlant(Plant):
    """An FMU instance of this process, started and at rest.

    Args:
        file: the ``.fmu``.
        parameters: start values by name.
        period: seconds a step; None takes the FMU's default experiment.
        kind: "co-simulation" or "model exchange"; None takes the first that it offers.
        watch: names of further variables that come back with the outputs.
        folder: where to extract; None makes a temporary folder that `close` removes.

    Raises:
        PlantError: what `open_plant` says.
    """

    def __init__(
        self,
        file: Path,
        *,
        parameters: Mapping[str, float],
        period: float | None = None,
        kind: str | None = None,
        watch: Sequence[str] = (),
        folder: Path | None = None,
    ) -> None:
        self._instance: Instance | None = None
        self._failure: str | None = None
        self._count = 0
        description, kind = read_description(file, kind)
        self._variables = VariableAccess(description, watch)
        self._start = _start_time(description)
        roles = self._variables.roles
        interface = (
            description.modelExchange if kind == "model exchange" else description.coSimulation
        )
        self._info = PlantInfo(
            name=description.modelName,
            fmi_version=description.fmiVersion,
            kind=kind,
            period=_period(description, period, file),
            inputs=roles.inputs,
            tunable=roles.tunable,
            outputs=(*roles.outputs, *self._variables.watched),
            parameters=roles.parameters,
            can_restore=bool(interface.canGetAndSetFMUstate and interface.canSerializeFMUstate),
        )
        self._period = self._info.period
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        if folder is None:
            self._folder = tempfile.TemporaryDirectory(
                prefix="fieldlink-fmu-", ignore_cleanup_errors=True
            )
            folder = Path(self._folder.name)
        try:
            extract_fmu(file, folder)
            fmu = load(description, kind, folder)
            version = int(description.fmiVersion[0])
            if kind == "model exchange":
                self._instance = ModelExchange(fmu, version, description, self._info.period)
            else:
                self._instance = CoSimulation(fmu, version)
            self._begin(self._instance, parameters)
        except BaseException:
            self.close()
            raise

    def _begin(self, instance: Instance, parameters: Mapping[str, float]) -> None:
        try:
            instance.start(
                lambda: self._variables.write(instance.fmu, parameters, before_start=True),
                self._start,
            )
        except (FMICallException, StoppedError) as error:
            self._failure = f"plant {self._info.name} refused to start: {error}{last_words()}"
            raise PlantStepError(self._failure) from error
        self._outputs = self._variables.read_outputs(instance.fmu, self._start)

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._info

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self._start + self._count * self._info.period

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
            instance.advance(self._start + self._count * self._period, self._period)
            self._count += 1
            now = self._start + self._count * self._period
            self._outputs = self._variables.read_outputs(instance.fmu, now)
        except (FMICallException, StoppedError) as error:
            raise self._failed(f"{error}{last_words()}") from error
        except PlantStepError as error:
            self._failure = str(error)
            raise
        return self._outputs.copy()

    def _write(self, instance: Instance, inputs: Mapping[str, float]) -> None:
        try:
            instance.change(lambda: self._variables.write(instance.fmu, inputs, before_start=False))
        except StoppedError as error:
            raise self._failed(f"{error}{last_words()}") from error
        except FMICallException as error:
            raise PlantInputError(
                f"plant {self._info.name} at {self.time:g} s does not take {dict(inputs)}"
                f"{last_words()}"
            ) from error

    def _failed(self, what: str) -> PlantStepError:
        self._failure = (
            f"plant {self._info.name}: the step from {self.time:g} s by {self._info.period:g} s "
            f"failed: {what}"
        )
        return PlantStepError(self._failure)

    def run(self, count: int, inputs: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
        """Step ``count`` times; see `Plant.run`."""
        instance = self._alive()
        held, columns = split_columns(count, inputs)
        forget_words()
        if held:
            self._write(instance, held)
        variables, fmu, period, start = (
            self._variables,
            instance.fmu,
            self._info.period,
            self._start,
        )
        write = variables.column_writer(columns)
        table = np.empty((count, len(self._info.outputs)))
        done = 0
        try:
            for k in range(count):
                if columns:
                    instance.change(functools.partial(write, fmu, k))
                instance.advance(start + self._count * period, period)
                self._count += 1
                variables.read_row(fmu, table[k])
                done = k + 1
        except (FMICallException, StoppedError) as error:
            raise self._failed(f"{error}{last_words()}") from error
        names = self._info.outputs
        wrong = np.argwhere(~np.isfinite(table[:done]))
        if wrong.size:
            row, column = wrong[0]
            moment = start + (self._count - count + row + 1) * period
            self._failure = variables.not_finite(names[column], table[row, column], moment)
            raise PlantStepError(self._failure)
        if count:
            self._outputs = dict(zip(names, table[-1].tolist(), strict=True))
        return {name: table[:, i].copy() for i, name in enumerate(names)}

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs``."""
        return [self.step(values) for values in inputs]

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
        return _SNAPSHOT_HEAD.pack(_SNAPSHOT_MARK, self._count, self._info.period) + content

    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned."""
        instance = self._opened()
        self._check_can_restore()
        head = snapshot[: _SNAPSHOT_HEAD.size]
        if len(head) < _SNAPSHOT_HEAD.size or head[:4] != _SNAPSHOT_MARK:
            raise PlantInputError(f"plant {self._info.name}: these bytes are no snapshot")
        _mark, count, period = _SNAPSHOT_HEAD.unpack(head)
        if period != self._info.period:
            raise PlantInputError(
                f"plant {self._info.name}: the snapshot was taken at a period of {period:g} s, "
                f"the plant has {self._info.period:g} s; open it with that period"
            )
        forget_words()
        try:
            instance.restore(snapshot[_SNAPSHOT_HEAD.size :])
        except (FMICallException, struct.error) as error:
            raise PlantInputError(
                f"plant {self._info.name} cannot restore this snapshot{last_words()}"
            ) from error
        self._count = count
        self._failure = None
        self._outputs = self._variables.read_outputs(instance.fmu, self.time)

    def _check_can_restore(self) -> None:
        if not self._info.can_restore:
            raise PlantStepError(
                f"plant {self._info.name}: its FMU offers no serialised state, so no snapshot"
            )

    def _alive(self) -> Instance:
        if self._failure is not None:
            raise PlantClosedError(f"the plant failed before: {self._failure}")
        return self._opened()

    def _opened(self) -> Instance:
        if self._instance is None:
            raise PlantClosedError(f"plant {self._info.name} is closed; open it again")
        return self._instance

    def close(self) -> None:
        """End the instance, unload the library and remove the temporary folder."""
        instance, self._instance = self._instance, None
        if instance is not None:
            instance.close(healthy=self._failure is None)
        if self._folder is not None:
            self._folder.cleanup()


def _start_time(description: Any) -> float:
    experiment = description.defaultExperiment
    return float(experiment.startTime) if experiment and experiment.startTime else 0.0


def _period(description: Any, wanted: float | None, file: Path) -> float:
    experiment = description.defaultExperiment
    if wanted is None and experiment and experiment.stepSize:
        wanted = float(experiment.stepSize)
    if wanted is None:
        raise PlantError(f"{file}: the FMU names no step size; give the period in seconds")
    if not 0.0 < wanted < float("inf"):
        raise PlantInputError(f"{file}: the period must be a positive number; got {wanted!r}")
    return wanted
