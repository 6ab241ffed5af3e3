"""Curves for the charts of a loop: samples thinned so that no extreme is lost, and the stem.

Up to `RAW` samples are given as they are. More than that become the least and the greatest value of
each bucket of time, two points a bucket, which draw the same line on any screen.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.stem_start import likeliest_start
from fieldlink.web.view.store_queries import Row, StoreQueries
from loop_model import ValveModel

__all__ = ["RAW", "curves", "phase", "stem_of"]

RAW = 4000
"""Samples that are given one by one: two for each pixel of a wide screen."""

MOST = 20_000
"""Points that a request may ask for: ten thousand buckets."""

LONGEST_MS = 400 * 86_400_000
"""Range of a request: a year and the weeks around it."""

SHORT_GAP = 3
"""Slots from one sample to the next up to which the stem is taken to stay; over a longer gap it may
have slipped unseen, as in the seconds in which a compensator takes over."""

Numbers = list[float | None]


def curves(
    queries: StoreQueries,
    loop: str,
    judged: Row | None,
    *,
    since_ms: int | None,
    until_ms: int | None,
    last_ms: int | None = None,
    live: bool = True,
    points: int = RAW,
) -> dict[str, Any]:
    """Return the trend of a loop.

    Args:
        queries: the store.
        loop: the loop's name.
        judged: the last estimate with a verdict, for the stem; None without one.
        since_ms, until_ms: the range; until now, and from an hour before, where None.
        last_ms: instead of a range, so many milliseconds up to its end.
        live: whether the end is now; in a store without a writer it is the newest sample.
        points: the most points for each signal.

    Returns:
        ``time`` in seconds since 1970, ``op``, ``pv``, ``sp`` and ``stem`` (None where not shown),
        ``samples`` in the range, and whether they were ``thinned``.

    Raises:
        StoreError: the store cannot be read.
    """
    points = max(100, min(points, MOST))
    until = _end(queries, loop, live=live) if until_ms is None else until_ms
    since = until - (last_ms or 3_600_000) if since_ms is None else since_ms
    since = max(since, until - LONGEST_MS)
    count = queries.sample_count(loop, since, until)
    if count <= points:
        found = _raw(queries.samples(loop, since, until, points), judged)
    else:
        bucket = max(1, -(-(until - since) // (points // 2)))
        found = _thinned(queries.extremes(loop, since, until, bucket), bucket)
    return {
        "since": since / 1000.0,
        "until": until / 1000.0,
        "samples": count,
        "thinned": count > points,
        **found,
    }


def stem_of(
    op: Numbers, judged: Row | None, slots: Sequence[int] | None = None, pv: Numbers | None = None
) -> Numbers | None:
    """Return the stem of the identified valve for each OP; None without a sticky valve.

    None, too, where PV tells that the simulated stem is not the true one.

    Args:
        op: None where a value is missing.
        judged: the estimate that names the valve.
        pv: as long as ``op``; without it the stem begins at the first OP.
        slots: of the values, where some slots have none; without it they follow each other.
    """
    if judged is None or judged["verdict"] != "stiction" or not op:
        return None
    S, J = judged["stick_band"], judged["slip_jump"]
    if S is None or J is None or not 0.0 <= J <= S:
        return None
    signal = np.array([math.nan if value is None else value for value in op])
    good = np.flatnonzero(np.isfinite(signal))
    if good.size == 0:
        return None
    # Where OP is missing the valve is taken to stay; before its first move the stem is unknown.
    last = np.maximum.accumulate(np.where(np.isfinite(signal), np.arange(signal.size), good[0]))
    valve, start = ValveModel(S, J), float(signal[good[0]])
    if pv is not None:
        measured = np.array([math.nan if value is None else value for value in pv])
        found = likeliest_start(
            lambda at: valve.simulate(signal[last], at),
            signal[last],
            measured,
            stick_band=S,
            slip_jump=J,
        )
        if found is None:
            return None
        start = found
    stem = valve.simulate(signal[last], start)
    moved = np.flatnonzero(stem != start)
    first = int(moved[0]) if moved.size else signal.size
    stem[:first] = math.nan
    lost: Sequence[int] = (
        () if slots is None else (np.flatnonzero(np.diff(slots) > SHORT_GAP) + 1).tolist()
    )
    for begin, end in pairwise([*lost, signal.size]):
        stem[begin:end] = _known_again(valve, signal[last[begin:end]])
    return [None if math.isnan(x) else round(float(x), 6) for x in stem]


def _known_again(valve: ValveModel, op: NDArray[np.float64]) -> NDArray[np.float64]:
    """The stem where both ends of what it may have been at first come within a slip, else NaN."""
    ends = (op[0] - valve.static_friction, op[0] + valve.static_friction)
    low, high = (valve.simulate(op, float(end)) for end in ends)
    return np.where(np.abs(low - high) <= valve.slip_jump + 1e-9, low, math.nan)


def phase(rows: list[Row], judged: Row | None) -> dict[str, Numbers]:
    """Return PV, OP and stem of a window for PV over OP: one value a slot, None for a missing one.

    The stem is simulated; the identified one, which comes with the cost map, is better.
    """
    if not rows or judged is None:
        return {"op": [], "pv": [], "stem": []}
    by_slot = {row["slot"]: row for row in rows}
    slots = [by_slot.get(slot) for slot in range(judged["first_slot"], judged["last_slot"] + 1)]
    op, pv = ([None if row is None else row[name] for row in slots] for name in ("op", "pv"))
    return {"op": op, "pv": pv, "stem": stem_of(op, judged, pv=pv) or []}


def _end(queries: StoreQueries, loop: str, *, live: bool) -> int:
    newest = None if live else queries.last_samples([loop]).get(loop)
    return round(time.time() * 1000.0) if newest is None else int(newest["utc_ms"])


def _raw(rows: list[Row], judged: Row | None) -> dict[str, Any]:
    op: Numbers = [row["op"] for row in rows]
    pv: Numbers = [row["pv"] for row in rows]
    sp = [row["sp"] for row in rows]
    return {
        "time": [row["utc_ms"] / 1000.0 for row in rows],
        "op": op,
        "pv": pv,
        "sp": sp if any(value is not None for value in sp) else None,
        "stem": stem_of(op, judged, [row["slot"] for row in rows], pv),
        "slots": [row["slot"] for row in rows],
    }


def _thinned(rows: list[Row], bucket: int) -> dict[str, Any]:
    def both(name: str) -> Numbers:
        return [value for row in rows for value in (row[f"{name}_low"], row[f"{name}_high"])]

    sp = both("sp")
    return {
        "time": [
            moment
            for row in rows
            for moment in (
                row["bucket"] * bucket / 1000.0,
                (row["bucket"] * bucket + bucket // 2) / 1000.0,
            )
        ],
        "op": both("op"),
        "pv": both("pv"),
        "sp": sp if any(value is not None for value in sp) else None,
        "stem": None,
        "slots": None,
    }
