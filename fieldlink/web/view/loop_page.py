"""Everything about one loop: verdict and why, valve over weeks, blocks, orders of operators."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from fieldlink.daemon import WritebackOutcome
from fieldlink.site import Site
from fieldlink.web.view.causes import findings_of_loop
from fieldlink.web.view.compensation import before_and_after
from fieldlink.web.view.fleet_view import Document, Fleet, FleetView
from fieldlink.web.view.reasons import what_to_do, what_would_help, why
from fieldlink.web.view.store_queries import DAY_MS, Row, StoreQueries
from fieldlink.web.view.texts import iso_time

__all__ = ["ATTEMPTS", "loop_document"]

ATTEMPTS = 200
"""Write-back attempts and decisions that a loop's page looks back."""

WINDOW = 800
"""Samples of a window without a site file: the site file's own default."""

ORDERS = 30
"""Orders of operators that a loop's page lists."""


def loop_document(
    queries: StoreQueries, view: FleetView, fleet: Fleet, site: Site | None, name: str
) -> Document | None:
    """Return what is known of a loop, None when there is no such loop.

    Raises:
        StoreError: the store cannot be read.
    """
    row = next((row for row in fleet.rows if row["name"] == name), None)
    if row is None:
        return None
    judged = view.judged_of(name, fleet.status)
    last = queries.last_estimates([name]).get(name)
    settings = None if site is None else site.loops.get(name)
    live = None if fleet.status is None else fleet.status.loops.get(name)
    now_ms = round(time.time() * 1000.0)
    latest = None if live is None else live.latest
    return {
        **row,
        "estimate": _estimate(judged),
        "diagnosis": view.diagnosis_of(name),
        "findings": findings_of_loop(queries, name),
        "why": why(judged, last, compensated=row["compensated"]),
        "to_do": what_to_do(judged) if row["verdict"] == "stiction" else [],
        "surer": what_would_help(row, judged, settings, "" if live is None else live.fault),
        "course": _course(view, name),
        "compensation": before_and_after(
            queries, name, WINDOW if settings is None else settings.window
        ),
        "written": _written(queries.attempts(name, ATTEMPTS)),
        "orders": [
            _order(one)
            for one in queries.events("operator.", now_ms - 400 * DAY_MS, ORDERS, source=name)
        ],
        "settings": None
        if settings is None
        else {
            "period_s": settings.period,
            "window": settings.window,
            "estimate_every_s": settings.estimate_period,
            "tags": {"OP": settings.op, "PV": settings.pv, "SP": settings.sp},
            "writeback": settings.writeback.enabled,
            "limits": {
                "stick_band": settings.writeback.limits.stick_band,
                "slip_jump": settings.writeback.limits.slip_jump,
            },
            "min_windows": settings.writeback.min_windows,
        },
        "latest": None
        if latest is None
        else {"time": iso_time(latest.utc_ms), "op": latest.op, "pv": latest.pv, "sp": latest.sp},
        "samples_until_estimate": None if live is None else live.samples_until_estimate,
    }


def _estimate(row: Row | None) -> Document | None:
    if row is None:
        return None
    document: Mapping[str, Any] = row["document"] or {}
    return {
        "id": row["id"],
        "window_end": iso_time(row["window_end_ms"]),
        "samples": document.get("samples"),
        "r2": (document.get("fit") or {}).get("r2"),
        "r2_healthy_valve": (document.get("fit") or {}).get("r2_healthy_valve"),
        "process": document.get("process"),
        "score": row["score"],
        "law": (document.get("evidence") or {}).get("law"),
    }


def _course(view: FleetView, name: str) -> Document:
    points = view.points_of(name)
    since, course = view.course_of(name)
    return {
        "time": [row["window_end_ms"] / 1000.0 for row in points],
        "verdict": [row["verdict"] for row in points],
        **{
            key: [row[key] if row["verdict"] == "stiction" else None for row in points]
            for key in (
                "stick_band",
                "stick_band_low",
                "stick_band_high",
                "slip_jump",
                "slip_jump_low",
                "slip_jump_high",
            )
        },
        "trend_from": since[0]["window_end_ms"] / 1000.0 if since else None,
        "changes": [] if course is None else course.changes,
    }


def _written(rows: list[Row]) -> list[Document]:
    """The attempts, newest first; the same decision many times in a row is one with a count."""
    found: list[Document] = []
    for row in rows:
        one = _attempt(row)
        last = found[-1] if found else None
        if last is not None and not one["written"] and _same(one, last):
            last["times"] += 1
            last["first_ms"], last["first"] = one["time_ms"], one["time"]
        else:
            found.append(one)
    return found


def _same(one: Document, other: Document) -> bool:
    return all(one[key] == other[key] for key in ("outcome", "reason", "written"))


def _attempt(row: Row) -> Document:
    outcome = WritebackOutcome.of(row["outcome"])
    return {
        "time_ms": row["utc_ms"],
        "time": iso_time(row["utc_ms"]),
        "outcome": row["outcome"],
        "advice": outcome.advice,
        "reason": row["reason"],
        "seq": row["seq"],
        "bank": row["bank"],
        "status": row["status"],
        "stick_band": row["stick_band"],
        "slip_jump": row["slip_jump"],
        "written": row["words"] is not None,
        "times": 1,
        "first_ms": row["utc_ms"],
        "first": iso_time(row["utc_ms"]),
    }


def _order(row: Row) -> Document:
    detail = row["detail"] or {}
    return {
        "time_ms": row["utc_ms"],
        "time": iso_time(row["utc_ms"]),
        "action": row["kind"].removeprefix("operator."),
        "who": detail.get("who", ""),
        "why": detail.get("why", row["message"]),
    }
