"""Types of an FMU's variables: how FMI calls them, their C types and ranges, which can be set."""

from __future__ import annotations

from ctypes import sizeof
from typing import Any

import numpy as np
from fmpy import fmi1, fmi2, fmi3
from numpy.typing import NDArray

__all__ = [
    "FUNCTIONS",
    "LEFT_OUT",
    "REAL_TYPES",
    "REFERENCE_TYPES",
    "STRING_TYPES",
    "describe_range",
    "is_settable",
    "list_starts",
    "view_memory",
]

LEFT_OUT = {
    "String": "because a table of numbers has no place for strings",
    "Binary": "because a table of numbers has no place for binary data",
    "Clock": "because a clock has ticks, no value; what its ticks change is recorded",
}
"""Types of variables that are not columns, and why."""

# Version of FMI -> type in the model description -> (get and set function, type in C).
FUNCTIONS: dict[int, dict[str, tuple[str, Any]]] = {
    1: {
        "Real": ("Real", fmi1.fmi1Real),
        "Integer": ("Integer", fmi1.fmi1Integer),
        "Enumeration": ("Integer", fmi1.fmi1Integer),
        "Boolean": ("Boolean", fmi1.fmi1Boolean),
    },
    2: {
        "Real": ("Real", fmi2.fmi2Real),
        "Integer": ("Integer", fmi2.fmi2Integer),
        "Enumeration": ("Integer", fmi2.fmi2Integer),
        "Boolean": ("Boolean", fmi2.fmi2Boolean),
    },
    3: {
        **{
            kind: (kind, getattr(fmi3, f"fmi3{kind}"))
            for kind in (
                *("Float64", "Float32", "Int64", "Int32", "Int16", "Int8"),
                *("UInt64", "UInt32", "UInt16", "UInt8", "Boolean"),
            )
        },
        "Enumeration": ("Int64", fmi3.fmi3Int64),
    },
}
REFERENCE_TYPES = {
    1: fmi1.fmi1ValueReference,
    2: fmi2.fmi2ValueReference,
    3: fmi3.fmi3ValueReference,
}
STRING_TYPES = {1: fmi1.fmi1String, 2: fmi2.fmi2String, 3: fmi3.fmi3String}
REAL_TYPES = ("Real", "Float64", "Float32")


def is_settable(variable: Any) -> bool:
    """Whether a variable (FMPy's) can be set before the start, in every version of FMI."""
    if variable.causality in ("parameter", "input"):
        return True
    if variable.causality in ("independent", "structuralParameter", "calculatedParameter"):
        return False
    if variable.variability == "constant":
        return False
    if variable.initial is None:  # FMI 1 has no such attribute: what has a start value
        return variable.start is not None
    return variable.initial in ("exact", "approx")


def list_starts(variable: Any) -> list[float]:
    """Return the start values of an array's elements; those that are not given are zero."""
    words = {"true": 1.0, "false": 0.0}
    given = [words[t] if t in words else float(t) for t in (variable.start or "").split()]
    size = int(np.prod(variable.shape)) if variable.shape else 0
    return given + [0.0] * max(0, size - len(given))


def describe_range(c_type: Any) -> str:
    """Return the range of an integer type of C, in words."""
    bits = 8 * sizeof(c_type)
    signed = c_type(-1).value < 0
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return f"{low} to {high}"


def view_memory(values: Any) -> NDArray[Any]:
    """Return the memory of a C array as a NumPy array; FMI 1's booleans are bytes."""
    if values._type_ is fmi1.fmi1Boolean:
        return np.frombuffer(values, dtype=np.uint8)
    array: NDArray[Any] = np.ctypeslib.as_array(values)
    return array
