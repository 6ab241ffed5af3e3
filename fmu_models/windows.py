"""Windows of a plant whose controller is inside it: what an estimator gets, many a second."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .catalogue import LoopVariables
from .plant import Plant

__all__ = ["collect_windows"]

_ONE_LOOP = LoopVariables()


def collect_windows(
    plant: Plant, samples: int, loop: LoopVariables = _ONE_LOOP
) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Yield windows one after another, for as long as they are asked for.

    A row is what a controller sees and does in one scan: OP was computed from the PV of its row.

    Args:
        plant: of the catalogue, opened with its ``controller`` set to 1 (and ``watch=[loop.sp]``
            where the set-point is wanted).
        samples: of a window.
        loop: the names of the loop's variables.

    Yields:
        ``op`` (as applied), ``pv``, ``stem`` and, where it is watched, ``sp``; each ``(samples,)``.
    """
    before = plant.outputs()[loop.pv]
    wanted = {"op": loop.op_out, "stem": loop.stem, "sp": loop.sp}
    while True:
        table = plant.run(samples, {})
        pv = table[loop.pv]
        window = {role: table[name] for role, name in wanted.items() if name in table}
        yield window | {"pv": np.concatenate([[before], pv[:-1]])}
        before = float(pv[-1])
