"""Rows of outputs in memory that a plant's process and its client share.

The process writes a row, then counts it; so the client has every step that was done, however the
process ends, and sees whether a step takes too long. The file behind the memory has no name.
"""

from __future__ import annotations

import mmap
import os
import tempfile

import numpy as np
from numpy.typing import NDArray

__all__ = ["SharedRows", "create_memory", "rows_that_fit"]

_HEAD_BYTES = 64
_TABLE_BYTES = 4 << 20
"""For the rows of one message: 4 MiB hold 4096 rows of 128 outputs; pages that are not used cost
nothing."""
_MOST_ROWS = 4096


def create_memory() -> int:
    """Return the descriptor of an empty file without a name."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("fieldlink-fmu")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def rows_that_fit(columns: int) -> int:
    """Return how many rows of ``columns`` outputs one message may ask for."""
    return max(1, min(_MOST_ROWS, _TABLE_BYTES // (8 * (columns + 1))))


class SharedRows:
    """The memory as arrays.

    Args:
        descriptor: of the file, which both sides map.
        columns: outputs of a row.

    Attributes:
        progress: shape ``(1,)``, rows that are done.
        moments: shape ``(rows,)``, seconds.
        table: shape ``(rows, columns)``.
    """

    def __init__(self, descriptor: int, columns: int) -> None:
        rows = rows_that_fit(columns)
        size = _HEAD_BYTES + 8 * rows * (columns + 1)
        os.ftruncate(descriptor, size)
        memory = mmap.mmap(descriptor, size)
        self.progress: NDArray[np.int64] = np.frombuffer(memory, dtype=np.int64, count=1)
        self.moments: NDArray[np.float64] = np.frombuffer(
            memory, dtype=np.float64, count=rows, offset=_HEAD_BYTES
        )
        self.table: NDArray[np.float64] = np.frombuffer(
            memory, dtype=np.float64, count=rows * columns, offset=_HEAD_BYTES + 8 * rows
        ).reshape(rows, columns)
