"""The cost over S and J behind a verdict: the window judged once more in a process apart."""

from __future__ import annotations

import math
from concurrent.futures import TimeoutError as NotReady
from typing import Any

from fieldlink.site import Site
from fieldlink.web.analyst import Analyst, WindowSamples
from fieldlink.web.view.store_queries import Row, StoreQueries

__all__ = ["cost_map"]

PATIENCE = 1.0
"""Seconds that a request waits for the map; after that the page asks again."""


def cost_map(
    queries: StoreQueries, analyst: Analyst, judged: Row, site: Site | None
) -> dict[str, Any]:
    """Return the cost map of an estimate.

    Args:
        queries: the store, which has the window's samples.
        analyst: computes the map.
        judged: the estimate.
        site: gives the loop's settings of estimation, None where only a store is known.

    Returns:
        ``state``: ``ready`` with ``stick_band``, ``slip_jump``, ``cost`` (rows are S), the
        window's ``stem`` and ``pv_model``, and whether the verdict is ``sticky``; ``computing``;
        or ``failed`` with ``message``.

    Raises:
        StoreError: the store cannot be read.
    """
    samples = _samples(queries.window(judged), judged, site)
    if samples is None:
        said = "the samples of this window are no longer in the store; the next window has a map"
        return {"state": "failed", "message": said}
    working = analyst.explain(judged["loop"], judged["id"], samples)
    try:
        found = working.result(timeout=PATIENCE)
    except NotReady:
        return {"state": "computing", "estimate": judged["id"]}
    except Exception as error:  # noqa: BLE001  (reported on the page, which goes on)
        said = str(error) or "its process ended"
        return {"state": "failed", "message": f"the map could not be computed: {said}"}
    return {
        "state": "ready",
        "estimate": judged["id"],
        "sticky": judged["verdict"] == "stiction",
        "stick_band": found.stick_band,
        "slip_jump": found.slip_jump,
        "cost": found.cost,
        "stem": found.stem,
        "pv_model": found.pv_model,
    }


def _samples(rows: list[Row], judged: Row, site: Site | None) -> WindowSamples | None:
    """The window with its gaps; None when less than half of it is left in the store."""
    first, last = judged["first_slot"], judged["last_slot"]
    by_slot = {row["slot"]: row for row in rows}
    length = last - first + 1
    if len(by_slot) < length / 2:
        return None
    held = [by_slot.get(slot) for slot in range(first, last + 1)]

    def column(name: str) -> list[float]:
        return [math.nan if row is None or row[name] is None else float(row[name]) for row in held]

    document = judged["document"] or {}
    settings = None if site is None else site.loops.get(judged["loop"])
    sp, auto = column("sp"), column("auto")
    return WindowSamples(
        op=column("op"),
        pv=column("pv"),
        sp=sp if any(map(math.isfinite, sp)) else None,
        auto=auto if any(map(math.isfinite, auto)) else None,
        period=float(document.get("period_s") or (1.0 if settings is None else settings.period)),
        criterion="auto" if settings is None else settings.estimator.criterion,
        confidence=float(judged["confidence"] or 0.9),
    )
