"""A loop before and after the compensator took over, in figures from the stored samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fieldlink.web.view.store_queries import Row, StoreQueries

__all__ = ["before_and_after"]

MOST = 5000
"""Samples of each side at most: several windows."""

SETTLE = 100
"""Samples after the take-over that are the way to the new state and not the state itself."""

LEAST, SHARE = 50, 3
"""Samples of each side that a standard deviation needs, and that part of a window: a window holds
several swings, and less than one of them has no deviation."""

BLOCKS = 200
"""Blocks looked back for the one with which the compensator took over."""


def before_and_after(queries: StoreQueries, loop: str, window: int) -> dict[str, Any] | None:
    """Compare the samples before the first block of the present run of blocks with the newest.

    Args:
        queries: the store.
        loop: the loop's name.
        window: samples of a window: so many are compared, where there are as many.

    Returns:
        ``since`` (UTC milliseconds) and for each of ``pv_std``, ``travel`` (of OP, for 100 samples)
        and ``reversals`` the figures ``before`` and ``after``; None where nothing is compensated or
        there are too few samples yet.

    Raises:
        StoreError: the store cannot be read.
    """
    begin: Row | None = None
    for row in queries.accepted_blocks(loop, BLOCKS):
        if row["status"] != "valid":
            break
        begin = row
    if begin is None:
        return None
    at, most = int(begin["utc_ms"]), min(window, MOST)
    after = queries.samples(loop, at, 2**62, 2 * most + SETTLE)[SETTLE:][-most:]
    before = queries.samples(loop, 0, at, most)
    length = min(len(before), len(after))
    if length < max(LEAST, most // SHARE):
        return None
    one, other = _figures(before[-length:]), _figures(after[-length:])
    return {
        "since": at,
        "samples": length,
        **{name: {"before": one[name], "after": other[name]} for name in one},
    }


def _figures(rows: list[Row]) -> dict[str, float | None]:
    op, pv, sp = (
        np.array([math.nan if row[name] is None else row[name] for row in rows])
        for name in ("op", "pv", "sp")
    )
    error = pv - sp if np.isfinite(sp).any() else pv
    known = error[np.isfinite(error)]
    moves = np.diff(op[np.isfinite(op)])
    turns = np.sign(moves[moves != 0.0])
    per_hundred = 100.0 / max(1, len(rows))
    return {
        "pv_std": float(np.std(known)) if known.size else None,
        "travel": float(np.abs(moves).sum()) * per_hundred,
        "reversals": float(np.count_nonzero(np.diff(turns))) * per_hundred,
    }
