"""A long run in pieces: rows are given away while the FMU goes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .columns import split_columns
from .errors import PlantError
from .plant import Piece

__all__ = ["PIECE_SECONDS", "fill_pieces"]

_ROWS = 4096
"""Steps whose outputs wait in memory before they are yielded."""
PIECE_SECONDS = 0.1
"""Of the wall clock, after which steps are yielded and looked through for NaN: what Ctrl-C loses of
a slow FMU, and a ten-thousandth of the time of a fast one."""


class Fill(Protocol):
    """Steps once for each row of a table; `InProcessPlant.fill` is one."""

    def __call__(
        self,
        inputs: Mapping[str, ArrayLike],
        table: NDArray[np.float64],
        moments: NDArray[np.float64],
        progress: NDArray[np.int64],
        *,
        last: float | None,
        seconds: float,
    ) -> None: ...


def fill_pieces(
    fill: Fill,
    names: Sequence[str],
    count: int,
    inputs: Mapping[str, ArrayLike],
    last: float | None,
) -> Iterator[Piece]:
    """Yield ``count`` steps, a piece at a time; what is done comes before a failure of ``fill``.

    Args:
        fill: steps the plant.
        names: of its outputs.
        count: of steps.
        inputs: by name, a number or an array ``(count,)``.
        last: seconds of the last step, where it is shorter than the period.
    """
    held, columns = split_columns(count, inputs)
    rows = min(count, _ROWS)
    table, moments = np.empty((rows, len(names))), np.empty(rows)
    progress = np.zeros(1, dtype=np.int64)
    done = 0
    while done < count:
        rows = min(rows, count - done)
        part: dict[str, Any] = {n: v[done : done + rows] for n, v in columns.items()}
        failure: BaseException | None = None
        try:
            fill(
                part if done else held | part,
                table[:rows],
                moments[:rows],
                progress,
                last=last if done + rows == count else None,
                seconds=PIECE_SECONDS,
            )
        except (PlantError, KeyboardInterrupt) as error:
            failure = error
        n = int(progress[0])
        if n:
            yield Piece(
                moments[:n].copy(), {name: table[:n, i].copy() for i, name in enumerate(names)}
            )
        if failure is not None:
            raise failure
        done += n
