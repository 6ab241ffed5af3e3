"""The devices: how each answers, what is late or missing, what it refuses, and the remedy."""

from __future__ import annotations

import time
from typing import Any

from fieldlink.daemon import DaemonStatus, DeviceStatus
from fieldlink.site import Site
from fieldlink.web.view.store_queries import DAY_MS, StoreQueries
from fieldlink.web.view.texts import iso_time

__all__ = ["devices_document"]

ERRORS = 5
"""Events of a device that are listed, newest first."""

STYLES = {"good": "good", "degraded": "warn", "demoted": "bad", "closed": "unknown"}


def devices_document(
    queries: StoreQueries, site: Site | None, status: DaemonStatus | None
) -> dict[str, Any]:
    """Return every device, and the store and the estimator beside them.

    Raises:
        StoreError: the store cannot be read.
    """
    now_ms = round(time.time() * 1000.0)
    events = queries.events("device.", now_ms - 30 * DAY_MS, 1000)
    names = list(status.devices) if status is not None else _named(site)
    devices = []
    for name in names:
        last = [
            {"time_ms": row["utc_ms"], "time": iso_time(row["utc_ms"]), "message": row["message"]}
            for row in events
            if row["source"] == name
        ][:ERRORS]
        live = None if status is None else status.devices[name]
        devices.append(
            {
                "name": name,
                "address": ""
                if site is None or name not in site.devices
                else site.devices[name].where,
                "loops": [] if site is None else list(site.loops_of(name)),
                "events": last,
                **_live(name, live, status),
            }
        )
    return {"devices": devices, "store": _store(status), "estimator": _estimator(status)}


def _named(site: Site | None) -> list[str]:
    if site is None:
        return []
    return list(dict.fromkeys(loop.device for loop in site.loops.values()))


def _address(site: Site | None, name: str) -> str:
    return "" if site is None or name not in site.devices else site.devices[name].where


def _live(name: str, device: DeviceStatus | None, status: DaemonStatus | None) -> dict[str, Any]:
    if device is None or status is None:
        return {"state": "unknown", "style": "unknown", "advice": "no daemon runs on this store"}
    loops = [loop.counts for loop in status.loops.values() if loop.device == name]
    state = device.state.name.lower()
    expected = sum(counts.expected for counts in loops)
    return {
        "state": state,
        "style": STYLES.get(state, "unknown"),
        "advice": device.state.advice,
        "last_failure": device.last_failure,
        "polls": device.polls,
        "skipped_polls": device.late,
        "requests": device.requests,
        "requests_per_poll": round(device.requests / device.polls, 1) if device.polls else None,
        "exceptions": device.failures,
        "connects": device.connects,
        "late_replies": device.late_replies,
        "latest_by_s": device.lateness.largest,
        "expected": expected,
        "missed": sum(counts.missed for counts in loops),
        "late": sum(counts.late for counts in loops),
        "bad": sum(counts.bad for counts in loops),
        "quality": sum(counts.read for counts in loops) / expected if expected else None,
        "quarantined": list(device.quarantined),
    }


def _store(status: DaemonStatus | None) -> dict[str, Any] | None:
    if status is None:
        return None
    store = status.store
    return {
        "failing": store.failing,
        "last_error": store.last_error,
        "written": store.written,
        "lost": store.dropped,
        "waiting": store.waiting,
    }


def _estimator(status: DaemonStatus | None) -> dict[str, Any] | None:
    if status is None:
        return None
    return {
        "workers": status.pool.workers,
        "waiting": status.pool.waiting,
        "rebuilt": status.pool.rebuilt,
        "judged": dict(status.pool.judged),
    }
