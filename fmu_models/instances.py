"""One FMU instance of any version: load, start, advance, save. Here: co-simulation.

`Instance` hides what differs between FMI 1, 2 and 3 and between co-simulation, where the solver is
inside (this module), and model exchange, where it is ours (`fmu_models.model_exchange`). What an
FMU says through its logger is kept for the next error message (`last_words`).

A step of co-simulation may come in parts: FMI 2 may discard the rest of a step, FMI 3 may return
early, at an event. The rest is computed from the time that was reached, after event mode where the
FMU has it.
"""

from __future__ import annotations

import contextlib
import math
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

__all__ = [
    "CoSimulation",
    "EndedError",
    "Instance",
    "StoppedError",
    "describe_refusal",
    "forget_words",
    "is_fatal",
    "last_words",
    "load",
]

# FMPy's logger of FMI 1 and 2 is one pointer for the whole process: it must be a function that
# lives as long as the process, so what the FMUs say is kept here for the next error message.
_said: deque[str] = deque(maxlen=5)
_WARNING, _DISCARD, _FATAL = 1, 2, 4
_MAX_PARTS = 10_000
"""Parts of one step; an FMU that returns early more often than that makes no progress."""
_MAX_EVENT_ITERATIONS = 1000
# FMPy declares these as returning text and would read a status as an address.
_STATUS_FUNCTIONS = [
    f"fmi1{name}"
    for name in (
        *("InitializeSlave", "DoStep", "CancelStep", "GetStatus", "GetRealStatus"),
        *("GetIntegerStatus", "GetBooleanStatus", "GetStringStatus"),
        *("SetRealInputDerivatives", "GetRealOutputDerivatives"),
    )
]


def _note(status: int, text: bytes) -> None:
    """Keep a warning or worse; what else an FMU logs explains no failure."""
    if status >= _WARNING:
        _said.append(" ".join(text.decode("utf-8", "replace").split()))


def _listen2(_environment: Any, _name: bytes, status: int, _category: bytes, text: bytes) -> None:
    _note(status, text)


def _listen3(_environment: Any, status: int, _category: bytes, text: bytes) -> None:
    _note(status, text)


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
    """The FMU did not do the step: it wants another step size, or does not come to an end."""


class EndedError(Exception):
    """The FMU ended the simulation in order.

    Attributes:
        reached: the second that it reached.
    """

    def __init__(self, reached: float) -> None:
        super().__init__(f"the FMU ended the simulation at {reached:g} s")
        self.reached = reached


def is_fatal(error: BaseException) -> bool:
    """Whether FMI forbids every further call of the FMU after this."""
    return isinstance(error, FMICallException) and error.status >= _FATAL


def describe_refusal(error: BaseException) -> str:
    """Return FMPy's words about a refused call, with what the FMU said, as one line."""
    return f"{str(error).rstrip('.')}{last_words()}"


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

    def configure(self, write: Callable[[], None]) -> None:
        """Let ``write`` set structural parameters, before anything else."""
        self.fmu.enterConfigurationMode()
        write()
        self.fmu.exitConfigurationMode()

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
            EndedError: it ended the simulation.
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
    """An FMU with its solver inside.

    Args:
        fmu: FMPy's object, instantiated.
        version: of FMI.
        event_mode: whether it was instantiated with event mode (FMI 3).
    """

    def __init__(self, fmu: Any, version: int, *, event_mode: bool = False) -> None:
        super().__init__(fmu, version)
        self._event_mode = event_mode

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
        if self._event_mode:  # FMI 3 stands in event mode now
            self._update_discrete(start_time)
            self.fmu.enterStepMode()

    def change(self, write: Callable[[], None]) -> None:
        """See `Instance.change`; discrete inputs of FMI 3 change in event mode."""
        if not self._event_mode:
            write()
            return
        self.fmu.enterEventMode()
        try:
            write()
            self._update_discrete(math.nan)
        finally:
            self.fmu.enterStepMode()

    def _update_discrete(self, time: float) -> None:
        for _ in range(_MAX_EVENT_ITERATIONS):
            again, terminate, *_rest = self.fmu.updateDiscreteStates()
            if terminate:
                raise EndedError(time)
            if not again:
                return
        raise StoppedError(f"its events at {time:g} s do not come to an end")

    def advance(self, time: float, size: float) -> None:
        """See `Instance.advance`."""
        goal = time + size
        reached = self._part(time, size, goal)
        for _ in range(_MAX_PARTS):
            if reached >= goal - 1e-12 * max(abs(goal), size):
                return
            reached = self._part(reached, goal - reached, goal)
        raise StoppedError(f"the FMU interrupts its step more than {_MAX_PARTS} times")

    def _part(self, time: float, size: float, goal: float) -> float:
        """Step on; return the second that was reached, ``goal`` as a rule."""
        try:
            answer = self.fmu.doStep(time, size)
        except FMICallException as error:
            if error.status != _DISCARD:
                raise
            reached = self._reached_before_discard(time, size)
            if reached is None:
                raise StoppedError(
                    f"the FMU discarded the step of {size:g} s, it got to {time:g} s; try another "
                    "period"
                ) from error
            return reached
        if self.version < 3:
            return goal
        event, terminate, early, last = answer
        reached = last if early and last < goal else goal
        if terminate:
            raise EndedError(reached)
        if self._event_mode and event:
            self.fmu.enterEventMode()
            self._update_discrete(reached)
            self.fmu.enterStepMode()
        return float(reached)

    def _reached_before_discard(self, time: float, size: float) -> float | None:
        """Return the second up to which a discarded step was computed; None for no progress.

        Raises:
            EndedError: it was discarded because the FMU has ended.
        """
        if self.version == 3:
            return None
        reached = time
        with contextlib.suppress(FMICallException):
            kind = fmi2.fmi2LastSuccessfulTime if self.version == 2 else fmi1.fmi1LastSuccessfulTime
            answer = self.fmu.getRealStatus(kind)
            reached = float(getattr(answer, "value", answer))
        if self.version == 2:
            ended = False
            with contextlib.suppress(FMICallException):
                ended = bool(self.fmu.getBooleanStatus(fmi2.fmi2Terminated))
            if ended:
                raise EndedError(max(time, reached))
        return reached if time + 1e-12 * max(abs(time), size) < reached < time + size else None


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
            fmu.instantiate(functions=_callbacks1, loggingOn=True)
        elif version == 2:
            fmu.instantiate(callbacks=_callbacks2, loggingOn=True)
        elif exchange:
            fmu.instantiate(logMessage=_listen3, loggingOn=True)
        else:
            fmu.instantiate(
                logMessage=_listen3,
                loggingOn=True,
                eventModeUsed=bool(interface.hasEventMode),
                earlyReturnAllowed=True,
            )
        if not fmu.component:  # FMPy does not look at FMI 1's answer
            raise RuntimeError("no instance was returned")
    except Exception as error:  # as above
        fmu.freeLibrary()
        raise PlantFileError(
            f"plant {description.modelName}: the FMU refused to be instantiated{last_words()}"
        ) from error
    return fmu
