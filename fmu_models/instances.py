"""One FMU instance of any version: load, start, advance, save. Here: co-simulation.

`Instance` hides what differs between FMI 1, 2 and 3 and between co-simulation, where the solver is
inside (this module), and model exchange, where it is ours (`fmu_models.model_exchange`). What an
FMU says through its logger is kept for the next error message (`last_words`).
"""

from __future__ import annotations

import contextlib
import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from ctypes import byref, c_int
from pathlib import Path
from typing import Any

from fmpy import calloc, fmi1, fmi2, fmi3, free
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from .errors import PlantFileError

__all__ = ["CoSimulation", "Instance", "StoppedError", "forget_words", "last_words", "load"]

# FMPy's logger of FMI 1 and 2 is one pointer for the whole process: it must be a function that
# lives as long as the process, so what the FMUs say is kept here for the next error message.
_said: deque[str] = deque(maxlen=5)
_DISCARD = 2
# FMPy declares these as returning text and would read a status as an address.
_STATUS_FUNCTIONS = [
    f"fmi1{name}"
    for name in (
        *("InitializeSlave", "DoStep", "CancelStep", "GetStatus", "GetRealStatus"),
        *("GetIntegerStatus", "GetBooleanStatus", "GetStringStatus"),
        *("SetRealInputDerivatives", "GetRealOutputDerivatives"),
    )
]


def _listen2(_environment: Any, _name: bytes, _status: int, _category: bytes, text: bytes) -> None:
    _said.append(text.decode("utf-8", "replace").strip())


def _listen3(_environment: Any, _status: int, _category: bytes, text: bytes) -> None:
    _said.append(text.decode("utf-8", "replace").strip())


def _callbacks(module: Any, version: int) -> Any:
    callbacks = getattr(module, f"fmi{version}CallbackFunctions")()
    callbacks.logger = getattr(module, f"fmi{version}CallbackLoggerTYPE")(_listen2)
    callbacks.allocateMemory = getattr(module, f"fmi{version}CallbackAllocateMemoryTYPE")(calloc)
    callbacks.freeMemory = getattr(module, f"fmi{version}CallbackFreeMemoryTYPE")(free)
    addLoggerProxy(byref(callbacks))
    return callbacks


_callbacks1 = _callbacks(fmi1, 1)
_callbacks2 = _callbacks(fmi2, 2)


def last_words() -> str:
    """Return what the FMU said since `forget_words`, as the end of a message."""
    return f": {' / '.join(_said)}" if _said else ""


def forget_words() -> None:
    """Begin a call whose messages count."""
    _said.clear()


class StoppedError(Exception):
    """The FMU did not do the step: it ended the simulation, or wants another step size."""


class Instance(ABC):
    """A loaded FMU.

    Args:
        fmu: FMPy's object, instantiated.
        version: of FMI, 1, 2 or 3.
    """

    def __init__(self, fmu: Any, version: int) -> None:
        self.fmu = fmu
        self.version = version
        self._started = False

    def start(self, write: Callable[[], None], start_time: float) -> None:
        """Let ``write`` set the start values, then initialise at ``start_time`` seconds."""
        write()
        self._initialise(start_time)
        self._started = True

    @abstractmethod
    def _initialise(self, start_time: float) -> None: ...

    def change(self, write: Callable[[], None]) -> None:
        """Let ``write`` set inputs between two steps."""
        write()

    @abstractmethod
    def advance(self, time: float, size: float) -> None:
        """Advance from ``time`` by ``size`` seconds.

        Raises:
            FMICallException: the FMU refused.
            StoppedError: it refused the step, with a reason.
        """

    def save(self) -> bytes:
        """Return the serialised state."""
        state = self.fmu.getFMUState()
        try:
            content: bytes = self.fmu.serializeFMUState(state)
        finally:
            self.fmu.freeFMUState(state)
        return content

    def restore(self, content: bytes) -> None:
        """Go back to a state that `save` returned."""
        state = self.fmu.deserializeFMUState(content)
        try:
            self.fmu.setFMUState(state)
        finally:
            self.fmu.freeFMUState(state)

    def close(self, *, healthy: bool) -> None:
        """Free the instance and unload the library."""
        if self._started and healthy:
            # An FMU that refuses to terminate is freed all the same: nothing depends on it.
            with contextlib.suppress(FMICallException):
                self.fmu.terminate()
        self.fmu.freeInstance()


class CoSimulation(Instance):
    """An FMU with its solver inside."""

    def _initialise(self, start_time: float) -> None:
        if self.version == 1:
            self.fmu.initialize(tStart=start_time)
            return
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start_time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start_time)
        self.fmu.exitInitializationMode()

    def advance(self, time: float, size: float) -> None:
        """See `Instance.advance`."""
        try:
            answer = self.fmu.doStep(time, size)
        except FMICallException as error:
            if error.status == _DISCARD:
                raise StoppedError(self._why_discarded(time, size)) from error
            raise
        if self.version == 3:
            _event, terminate, early, last = answer
            if terminate:
                raise StoppedError(f"the FMU ended the simulation at {last:g} s")
            if early:
                raise StoppedError(f"the FMU returned early, at {last:g} s, without leave")

    def _why_discarded(self, time: float, size: float) -> str:
        """Ask the FMU whether it has ended, or dislikes the step size."""
        if self.version == 3:
            return f"the FMU discarded the step of {size:g} s; try another period"
        reached = None
        with contextlib.suppress(FMICallException):
            kind = fmi2.fmi2LastSuccessfulTime if self.version == 2 else fmi1.fmi1LastSuccessfulTime
            answer = self.fmu.getRealStatus(kind)
            reached = float(getattr(answer, "value", answer))
        if self.version == 2:
            with contextlib.suppress(FMICallException):
                if self.fmu.getBooleanStatus(fmi2.fmi2Terminated):
                    at = time if reached is None else reached
                    return (
                        f"the FMU ended the simulation at {at:g} s (has it reached its stop time?)"
                    )
        done = "" if reached is None else f", it got to {reached:g} s"
        return f"the FMU discarded the step of {size:g} s{done}; try another period"


def load(description: Any, kind: str, folder: Path) -> Any:
    """Load the library of an extracted FMU and instantiate it; return FMPy's object.

    Args:
        description: FMPy's model description.
        kind: "co-simulation" or "model exchange".
        folder: where the FMU was extracted.

    Raises:
        PlantFileError: the library cannot be loaded, or refuses to be instantiated.
    """
    version = int(description.fmiVersion[0])
    exchange = kind == "model exchange"
    interface = description.modelExchange if exchange else description.coSimulation
    module = {1: fmi1, 2: fmi2, 3: fmi3}[version]
    cls = getattr(module, f"FMU{version}{'Model' if exchange else 'Slave'}")
    forget_words()
    try:
        # FMPy changes the working directory to load the library, and stays there on failure.
        with contextlib.chdir(os.curdir):
            fmu = cls(
                guid=description.guid,
                modelIdentifier=interface.modelIdentifier,
                unzipDirectory=str(folder),
                instanceName=description.modelName,
            )
    except Exception as error:  # FMPy raises nothing narrower
        raise PlantFileError(
            f"plant {description.modelName}: its library cannot be loaded: {error}; it is damaged, "
            "incomplete, or needs a library that this machine lacks"
        ) from error
    if version == 1 and not exchange:
        for name in _STATUS_FUNCTIONS:
            fmu._functions[name].restype = c_int
    try:
        if version == 1:
            fmu.instantiate(functions=_callbacks1)
        elif version == 2:
            fmu.instantiate(callbacks=_callbacks2)
        else:
            fmu.instantiate(logMessage=_listen3)
        if not fmu.component:  # FMPy does not look at FMI 1's answer
            raise RuntimeError("no instance was returned")
    except Exception as error:  # as above
        fmu.freeLibrary()
        raise PlantFileError(
            f"plant {description.modelName}: the FMU refused to be instantiated{last_words()}"
        ) from error
    return fmu
