"""The library of an FMU: load and instantiate it, call its functions, collect its messages.

What an FMU says through its logger is kept for the next error message (`last_words`).
"""

from __future__ import annotations

import contextlib
import os
import re
from collections import deque
from collections.abc import Callable, Sequence
from ctypes import byref, c_int
from pathlib import Path
from typing import Any

from fmpy import calloc, fmi1, fmi2, fmi3, free
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from .errors import PlantFileError

__all__ = [
    "call_checked",
    "describe_refusal",
    "forget_words",
    "is_fatal",
    "last_words",
    "load",
]

# FMPy's logger of FMI 1 and 2 is one pointer for the whole process: it must be a function that
# lives as long as the process, so what the FMUs say is kept here for the next error message.
_said: deque[str] = deque(maxlen=5)
_WARNING, _FATAL, _PENDING = 1, 4, 5
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


def is_fatal(error: BaseException) -> bool:
    """Whether FMI forbids every further call of the FMU after this."""
    return isinstance(error, FMICallException) and error.status >= _FATAL


def describe_refusal(error: BaseException) -> str:
    """Return FMPy's words about a refused call, with what the FMU said, as one line."""
    if getattr(error, "status", None) == _PENDING:
        return (
            "the FMU wants to compute its step beside this program (status pending), which is not "
            f"supported; export it without asynchronous steps{last_words()}"
        )
    return f"{str(error).rstrip('.')}{last_words()}"


def call_checked(fmu: Any, name: str, *arguments: Any) -> None:
    """Call a function of the FMU's library; FMPy's own way costs more than most FMUs' steps.

    Args:
        fmu: FMPy's object.
        name: as FMPy calls the function.
        arguments: as the FMI standard names them.

    Raises:
        FMICallException: the FMU refused.
    """
    status = fmu._functions[name](*arguments)
    if status > _WARNING:
        raise FMICallException(function=name, status=status)


_BUILD = re.compile(r"(?i)guid|token")
"""What FMUs speak of when the description beside them is another model's or another build's."""


def load(
    description: Any,
    kind: str,
    folder: Path,
    intermediate: tuple[Callable[..., None], Sequence[int]] | None = None,
) -> Any:
    """Load the library of an extracted FMU and instantiate it; return FMPy's object.

    Args:
        description: FMPy's model description.
        kind: "co-simulation" or "model exchange".
        folder: where the FMU was extracted.
        intermediate: FMI 3's callback between the ends of a step, and the value references that it
            reads; None for none.

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
                intermediateUpdate=None if intermediate is None else intermediate[0],
                requiredIntermediateVariables=None if intermediate is None else intermediate[1],
            )
        if not fmu.component:  # FMPy does not look at FMI 1's answer
            raise RuntimeError("no instance was returned")
    except Exception as error:  # as above
        fmu.freeLibrary()
        words = last_words()
        remedy = (
            "description and library are of two builds, so export the FMU again as a whole"
            if _BUILD.search(words)
            else "see to its licence and resources, and export it again as a whole"
        )
        raise PlantFileError(
            f"plant {description.modelName}: the FMU refused to be instantiated{words}; {remedy}"
        ) from error
    return fmu
