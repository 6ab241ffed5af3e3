"""The International Stiction Data Base of Jelali and Huang (2010): one MATLAB file.

It holds a structure ``cdata.chemicals.loop10`` with ``PV``, ``OP``, ``SP``, ``Ts`` and
``comments``. This project does not contain the file itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatReadError

from fieldlink.errors import FieldlinkError

__all__ = ["ReaderError", "RecordedLoop", "holds_one_loop", "isdb_loops", "read_isdb"]

Array = NDArray[np.float64]


class ReaderError(FieldlinkError, ValueError):
    """A file is not what its reader expects; the message names file, place, value and remedy."""


@dataclass(frozen=True, slots=True)
class RecordedLoop:
    """A recorded loop.

    Attributes:
        name: where it comes from.
        op, pv: samples, shape ``(n,)``, NaN where the file has none.
        sp: set-point, or None when the file has none.
        period_s: seconds between samples, or None when the file does not say.
        comments: what the file says about the loop.
    """

    name: str
    op: Array
    pv: Array
    sp: Array | None
    period_s: float | None
    comments: str


def _structure(path: Path) -> Mapping[str, Any]:
    try:
        changed = path.stat().st_mtime_ns
    except OSError as error:
        raise ReaderError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    return _load(path, changed)


@lru_cache(maxsize=1)
def _load(path: Path, _changed: int) -> Mapping[str, Any]:
    """Load a file and keep it until it changes: its loops are read one after the other."""
    try:
        contents = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise ReaderError(
            f"{path}: this is a MATLAB 7.3 (HDF5) file; save it again in MATLAB with -v7"
        ) from error
    except (ValueError, OSError, MatReadError) as error:
        raise ReaderError(f"{path}: not a MATLAB file ({error})") from error
    cdata = contents.get("cdata")
    if not isinstance(cdata, Mapping):
        names = [name for name in contents if not name.startswith("__")]
        raise ReaderError(f"{path}: no structure 'cdata' (the file holds {names})")
    return cdata


def holds_one_loop(path: Path) -> bool:
    """Whether a MATLAB file can be read and is not the data base."""
    try:
        return "cdata" not in {name for name, _, _ in whosmat(path)}
    except (NotImplementedError, ValueError, TypeError, LookupError, OSError, MatReadError):
        # Reading it says why.
        return False


def isdb_loops(path: str | Path) -> tuple[str, ...]:
    """Names of all loops in the file, e.g. ``"chemicals.loop10"``."""
    cdata = _structure(Path(path))
    return tuple(
        f"{area}.{loop}"
        for area, loops in cdata.items()
        if isinstance(loops, Mapping)
        for loop in loops
    )


def read_isdb(path: str | Path, loop: str) -> RecordedLoop:
    """Read one loop, e.g. ``read_isdb("isdb10.mat", "chemicals.loop10")``.

    Raises:
        ReaderError: the file, the loop or one of its fields is missing or malformed.
    """
    path = Path(path)
    area, _, name = loop.partition(".")
    loops = _structure(path).get(area)
    record = loops.get(name) if isinstance(loops, Mapping) else None
    if not isinstance(record, Mapping):
        raise ReaderError(f"{path}: no loop {loop!r}; there are {', '.join(isdb_loops(path))}")
    fields = {key.lower(): value for key, value in record.items()}

    def signal(key: str) -> Array | None:
        if key not in fields or np.size(fields[key]) == 0:
            return None
        try:
            return np.asarray(fields[key], dtype=np.float64).ravel()
        except (TypeError, ValueError) as error:
            raise ReaderError(f"{path}: cdata.{loop}.{key.upper()} is not numeric") from error

    op, pv, sp, period = signal("op"), signal("pv"), signal("sp"), signal("ts")
    if op is None or pv is None or op.size != pv.size:
        sizes = [None if s is None else s.size for s in (op, pv)]
        raise ReaderError(f"{path}: cdata.{loop} needs OP and PV of one length; it has {sizes}")
    if sp is not None and sp.size != pv.size:
        sp = np.full(pv.size, sp[0]) if sp.size == 1 else None
    seconds = float(period[0]) if period is not None else math.nan
    comments = fields.get("comments", "")
    return RecordedLoop(
        name=loop,
        op=op,
        pv=pv,
        sp=sp,
        period_s=seconds if math.isfinite(seconds) and seconds > 0.0 else None,
        comments=" ".join(str(part).strip() for part in np.atleast_1d(comments)).strip(),
    )
