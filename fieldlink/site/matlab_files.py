"""The signals of a MATLAB file, as columns.

    read_matlab_columns(Path("loop.mat"))  # {"op": [...], "pv": [...], "time": [...]}

A signal is a vector at the top of the file or in its one structure, or a signal that Simulink has
logged (a structure with ``signals``, its names in ``label``). One matrix has the columns
``column1``, ``column2`` and so on. The seconds between samples may be there as ``Ts``, or the
samples in a second as ``fs``.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fieldlink.site.errors import Problem, RecordingError

__all__ = ["read_matlab_columns"]

_PERIODS = ("ts", "dt", "period", "sampletime", "samplingtime", "sampling_period")
"""Names of a scalar that is the seconds between samples."""

_RATES = ("fs", "samplerate", "sample_rate", "samplingrate", "sampling_rate")
"""Names of a scalar that is the samples in a second."""

_SIMULINK_TIMES = "tout"
_TIMES = ("time", "t", _SIMULINK_TIMES)
"""Names of a vector of times."""


def read_matlab_columns(path: Path) -> dict[str, Iterable[Any]]:
    """Return the signals of a MATLAB file by their names, all of one length.

    Raises:
        RecordingError: it cannot be read, or holds no signals of one length.
    """
    named = _variables(path)
    structures = {name: value for name, value in named.items() if isinstance(value, Mapping)}
    if len(structures) == 1:
        # Ts may stand beside the structure or in it.
        beside = {name: value for name, value in named.items() if name not in structures}
        (structure,) = structures.values()
        named = _fields(structure) | beside
    vectors = {name: np.ravel(value) for name, value in named.items() if _is_vector(value)}
    matrices = [np.asarray(value) for value in named.values() if _is_matrix(value)]
    if not vectors and len(matrices) == 1:
        tall = matrices[0] if matrices[0].shape[0] >= matrices[0].shape[1] else matrices[0].T
        vectors = {f"column{at}": column for at, column in enumerate(tall.T, start=1)}
    longest = max((vector.size for vector in vectors.values()), default=0)
    columns: dict[str, Iterable[Any]] = {
        name: vector.tolist() for name, vector in vectors.items() if vector.size == longest
    }
    _refuse_odd(path, named, columns, longest)
    if len(structures) > 1 and not columns:
        what = f"holds {len(structures)} structures, {', '.join(named)}"
        raise _refusal(path, what, "save one in a file, with the vectors op and pv")
    if longest < 2:
        what = f"has no vectors of samples (it holds {', '.join(named) or 'nothing'})"
        remedy = "save vectors op and pv or one matrix, and the seconds between samples as Ts"
        raise _refusal(path, what, remedy)
    times = next((name for name in columns if name.lower() in _TIMES), None)
    if times is None:
        columns |= _counted_times(named, longest)
    elif times.lower() == _SIMULINK_TIMES:
        columns["time"] = columns.pop(times)
    return columns


def _variables(path: Path) -> dict[str, Any]:
    """The variables of the file by name, simplified by SciPy."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        what = "is a MATLAB 7.3 (HDF5) file"
        raise _refusal(path, what, "save it again in MATLAB with -v7") from error
    except (ValueError, TypeError, LookupError, OSError, MatReadError, zlib.error) as error:
        raise _refusal(path, "is not a MATLAB file that can be read", "save it again") from error
    named = {name: _full(value) for name, value in found.items() if not name.startswith("__")}
    if "cdata" in named:
        what = "is the International Stiction Data Base, which holds many loops"
        raise _refusal(path, what, "judge all of them with fieldlink assess")
    return named


def _fields(structure: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a structure; of one that Simulink has logged, its signals by their labels."""
    fields = {name: _full(value) for name, value in structure.items()}
    signals = fields.get("signals")
    logged = [signals] if isinstance(signals, Mapping) else signals
    if not isinstance(logged, (list, tuple, np.ndarray)) or not all(
        isinstance(signal, Mapping) and "values" in signal for signal in logged
    ):
        return fields
    del fields["signals"]
    for at, signal in enumerate(logged, start=1):
        label = str(signal.get("label", "")).strip() if np.size(signal.get("label", "")) else ""
        name, values = label or f"signal{at}", np.asarray(signal["values"])
        if _is_matrix(values):
            fields |= {f"{name}_{n}": column for n, column in enumerate(values.T, start=1)}
        else:
            fields[name] = values
    return fields


def _refuse_odd(
    path: Path, named: Mapping[str, Any], columns: Mapping[str, Any], longest: int
) -> None:
    """Raise where a signal or the times are there, but not as a vector of the others' length."""
    odd = [
        f"{name} is {_words_of(value)}"
        for name, value in named.items()
        if name not in columns
        and (name.lower() in ("op", "pv") or (name.lower() in _TIMES and np.size(value) > 1))
    ]
    if odd:
        what = f"{' and '.join(odd)}{f', and other signals have {longest}' if columns else ''}"
        remedy = "save op and pv, and the times if they are there, as vectors of one length"
        raise _refusal(path, what, f"{remedy}, of real numbers")


def _counted_times(named: Mapping[str, Any], count: int) -> dict[str, list[Any]]:
    """The column of times that Ts or fs gives; nothing where none of them is there.

    A value that is no length of time is put into every row, so that the reader names and refuses
    it. Simulink has 0 and -1 for models without a sample time of their own.
    """
    for names in (_PERIODS, _RATES):
        given = [v for name, v in named.items() if name.lower() in names and np.size(v) == 1]
        if len(given) != 1:
            continue
        value = np.ravel(given[0])[0]
        if np.asarray(value).dtype.kind not in "fiu" or not 0.0 < value < np.inf:
            return {"time": [value] * count}
        period = float(value) if names is _PERIODS else 1.0 / float(value)
        return {"time": (np.arange(count) * period).tolist()}
    return {}


def _is_vector(value: Any) -> bool:
    array = np.asarray(value)
    return array.dtype.kind in "bfiu" and array.size > 1 and array.size == max(array.shape)


def _is_matrix(value: Any) -> bool:
    array = np.asarray(value)
    return array.dtype.kind in "bfiu" and array.ndim == 2 and min(array.shape) > 1


def _full(value: Any) -> Any:
    """A value as an array where MATLAB has stored it sparse."""
    return value.toarray() if hasattr(value, "toarray") else value


def _words_of(value: Any) -> str:
    """What a signal is that is not a vector of samples."""
    array = np.asarray(value)
    if array.dtype.kind == "c":
        return "complex"
    if array.dtype.kind not in "bfiu":
        return "no array of numbers"
    if array.size <= 1:
        return "one number" if array.size else "empty"
    if _is_vector(value):
        return f"a vector of {array.size} samples"
    return f"an array of {' x '.join(map(str, array.shape))}"


def _refusal(path: Path, what: str, remedy: str) -> RecordingError:
    return RecordingError([Problem(str(path), "", what, remedy)])
