"""A plant in this process: fast, and a crash of the FMU takes the process with it."""

from __future__ import annotations

import contextlib
import os
import struct
import tempfile
from collections import deque
from collections.abc import Mapping, Sequence
from ctypes import byref
from pathlib import Path
from typing import Any

from fmpy import calloc, fmi2, fmi3, free
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from .archive import extract_fmu, read_description
from .errors import (
    PlantClosedError,
    PlantError,
    PlantFileError,
    PlantInputError,
    PlantStepError,
)
from .plant import Plant, PlantInfo
from .variables import VariableAccess

__all__ = ["InProcessPlant"]

_SNAPSHOT_HEAD = struct.Struct("<4sqd")
_SNAPSHOT_MARK = b"FLP1"

# FMPy's logger of FMI 2 is one pointer for the whole process: it must be a function that lives as
# long as the process, so what the FMUs say is kept here for the next error message.
_said: deque[str] = deque(maxlen=5)


def _listen2(_environment: Any, _name: bytes, _status: int, _category: bytes, text: bytes) -> None:
    _said.append(text.decode("utf-8", "replace"))


def _listen3(_environment: Any, _status: int, _category: bytes, text: bytes) -> None:
    _said.append(text.decode("utf-8", "replace"))


_callbacks2 = fmi2.fmi2CallbackFunctions()
_callbacks2.logger = fmi2.fmi2CallbackLoggerTYPE(_listen2)
_callbacks2.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
_callbacks2.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
_ = addLoggerProxy(byref(_callbacks2))


class InProcessPlant(Plant):
    """An FMU instance of this process, started and at rest.

    Args:
        file: the ``.fmu``.
        parameters: start values by name.
        period: seconds a step; None takes the FMU's default experiment.
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
        folder: Path | None = None,
    ) -> None:
        self._fmu: Any = None
        self._started = False
        self._failure: str | None = None
        self._count = 0
        description = read_description(file)
        self._variables = VariableAccess(description)
        self._fmi2 = description.fmiVersion.startswith("2.")
        self._start = _start_time(description)
        roles = self._variables.roles
        simulation = description.coSimulation
        self._info = PlantInfo(
            name=description.modelName,
            fmi_version=description.fmiVersion,
            period=_period(description, period, file),
            inputs=roles.inputs,
            tunable=roles.tunable,
            outputs=roles.outputs,
            parameters=roles.parameters,
            can_restore=bool(simulation.canGetAndSetFMUstate and simulation.canSerializeFMUstate),
        )
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        if folder is None:
            self._folder = tempfile.TemporaryDirectory(
                prefix="fieldlink-fmu-", ignore_cleanup_errors=True
            )
            folder = Path(self._folder.name)
        try:
            extract_fmu(file, folder)
            self._open(description, folder)
            self._begin(parameters)
        except BaseException:
            self.close()
            raise

    def _open(self, description: Any, folder: Path) -> None:
        kind = fmi2.FMU2Slave if self._fmi2 else fmi3.FMU3Slave
        _said.clear()
        try:
            # FMPy changes the working directory to load the library, and stays there on failure.
            with contextlib.chdir(os.curdir):
                fmu = kind(
                    guid=description.guid,
                    modelIdentifier=description.coSimulation.modelIdentifier,
                    unzipDirectory=str(folder),
                    instanceName=description.modelName,
                )
        except Exception as error:  # FMPy raises nothing narrower
            raise PlantFileError(
                f"plant {self._info.name}: its library cannot be loaded: {error}; it is damaged, "
                "incomplete, or needs a library that this machine lacks"
            ) from error
        try:
            if self._fmi2:
                fmu.instantiate(callbacks=_callbacks2)
            else:
                fmu.instantiate(logMessage=_listen3)
        except Exception as error:  # as above
            fmu.freeLibrary()
            raise PlantFileError(
                f"plant {self._info.name}: the FMU refused to be instantiated{_words()}"
            ) from error
        self._fmu = fmu

    def _begin(self, parameters: Mapping[str, float]) -> None:
        fmu = self._fmu
        try:
            self._variables.write(fmu, parameters, before_start=True)
            if self._fmi2:
                fmu.setupExperiment(startTime=self._start)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(startTime=self._start)
            fmu.exitInitializationMode()
        except FMICallException as error:
            raise PlantStepError(
                f"plant {self._info.name} refused to start: {error}{_words()}"
            ) from error
        self._started = True
        self._outputs = self._variables.read_outputs(fmu, self._start)

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
        self._check_alive()
        return dict(self._outputs)

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs, advance one period, return all outputs."""
        self._check_alive()
        _said.clear()
        try:
            self._variables.write(self._fmu, inputs, before_start=False)
        except FMICallException as error:
            raise PlantInputError(
                f"plant {self._info.name} at {self.time:g} s does not take {dict(inputs)}{_words()}"
            ) from error
        try:
            self._advance()
            self._count += 1
            self._outputs = self._variables.read_outputs(self._fmu, self.time)
        except FMICallException as error:
            raise self._failed(f"{error}{_words()}") from error
        except PlantStepError as error:
            self._failure = str(error)
            raise
        return dict(self._outputs)

    def _advance(self) -> None:
        period = self._info.period
        if self._fmi2:
            self._fmu.doStep(self.time, period)
            return
        _event, terminate, early, last = self._fmu.doStep(self.time, period)
        if terminate:
            raise self._failed(f"the FMU ended the simulation at {last:g} s")
        if early:
            raise self._failed(f"the FMU returned early, at {last:g} s, without leave")

    def _failed(self, what: str) -> PlantStepError:
        self._failure = (
            f"plant {self._info.name}: the step from {self.time:g} s by {self._info.period:g} s "
            f"failed: {what}"
        )
        return PlantStepError(self._failure)

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs``."""
        return [self.step(values) for values in inputs]

    def snapshot(self) -> bytes:
        """Return the plant's whole state."""
        self._check_alive()
        self._check_can_restore()
        state = self._fmu.getFMUState()
        try:
            content: bytes = self._fmu.serializeFMUState(state)
        finally:
            self._fmu.freeFMUState(state)
        return _SNAPSHOT_HEAD.pack(_SNAPSHOT_MARK, self._count, self._info.period) + content

    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned."""
        self._check_open()
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
        _said.clear()
        try:
            state = self._fmu.deserializeFMUState(snapshot[_SNAPSHOT_HEAD.size :])
        except FMICallException as error:
            raise PlantInputError(
                f"plant {self._info.name} cannot restore this snapshot{_words()}"
            ) from error
        try:
            self._fmu.setFMUState(state)
        finally:
            self._fmu.freeFMUState(state)
        self._count = count
        self._failure = None
        self._outputs = self._variables.read_outputs(self._fmu, self.time)

    def _check_can_restore(self) -> None:
        if not self._info.can_restore:
            raise PlantStepError(
                f"plant {self._info.name}: its FMU offers no serialised state, so no snapshot"
            )

    def _check_alive(self) -> None:
        if self._failure is not None:
            raise PlantClosedError(f"the plant failed before: {self._failure}")
        self._check_open()

    def _check_open(self) -> None:
        if self._fmu is None:
            raise PlantClosedError(f"plant {self._info.name} is closed; open it again")

    def close(self) -> None:
        """End the instance, unload the library and remove the temporary folder."""
        fmu, self._fmu = self._fmu, None
        if fmu is not None:
            if self._started and self._failure is None:
                # An FMU that refuses to terminate is freed all the same: nothing depends on it.
                with contextlib.suppress(FMICallException):
                    fmu.terminate()
            fmu.freeInstance()
        if self._folder is not None:
            self._folder.cleanup()


def _words() -> str:
    """Return what the FMU said since the last call began, as the end of a message."""
    return f": {' / '.join(_said)}" if _said else ""


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
