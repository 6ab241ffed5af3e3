"""What ``fieldlink status`` and ``fieldlink events`` show: plain JSON types, null for unknown.

`live_status` tells of a running daemon, `stored_status` what the store knows without one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.reporting.status import DaemonStatus, DeviceStatus, LoopStatus
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.findings import describe_finding
from fieldlink.links import LinkState
from fieldlink.site import Site
from fieldlink.store import EventRecord, FindingRecord

if TYPE_CHECKING:
    from fieldlink.store import FleetReader

__all__ = ["event_document", "finding_document", "live_status", "stored_status", "time_text"]

Document = dict[str, Any]

_DEVICE_EVENTS = tuple(f"device.{state.name.lower()}" for state in LinkState)
"""Kinds of the events that say how a device answers."""


def time_text(utc: float) -> str:
    """Return a time in seconds since 1970 as ISO 8601 in UTC."""
    return datetime.fromtimestamp(utc, UTC).isoformat(timespec="milliseconds")


def live_status(status: DaemonStatus, since: float) -> Document:
    """Return a running daemon's status.

    Args:
        status: its snapshot.
        since: when it began, seconds since 1970.
    """
    report = status.findings or FindingsReport()
    causes = report.causes
    return {
        "devices": [_device(name, device, status) for name, device in status.devices.items()],
        "loops": [
            {**_loop(name, loop), "cause": causes.get(name)} for name, loop in status.loops.items()
        ],
        "findings": [finding_document(one.record(one.seen_ms, "")) for one in report.open],
        "daemon": {"alive": True, "since": time_text(since)},
        "store": {
            "failing": status.store.failing,
            "reason": status.store.last_error if status.store.failing else "",
            "waiting": status.store.waiting,
            "lost": status.store.dropped,
        },
    }


def _device(name: str, device: DeviceStatus, status: DaemonStatus) -> Document:
    loops = [loop for loop in status.loops.values() if loop.device == name]
    late = device.lateness
    return {
        "name": name,
        "state": device.state.name.lower(),
        "requests": device.requests,
        "exceptions": device.failures,
        "late": device.late,
        "missed": sum(loop.counts.missed for loop in loops),
        "reason": device.last_failure if device.state.name != "GOOD" else "",
        "polls": device.polls,
        "latest_by": late.largest,
        "quarantined": list(device.quarantined),
    }


def _loop(name: str, loop: LoopStatus) -> Document:
    estimate = loop.last_estimate
    found = None if estimate is None else estimate.findings
    block = loop.block
    return {
        "name": name,
        "device": loop.device,
        "expected": loop.counts.expected,
        "read": loop.counts.read,
        "bad": loop.counts.bad,
        "fault": loop.fault,
        "missed": loop.counts.missed,
        "verdict": None if found is None else found.verdict,
        "stick_band": None if found is None else _number(found.stick_band.value),
        "stick_band_low": None if found is None else _number(found.stick_band.low),
        "stick_band_high": None if found is None else _number(found.stick_band.high),
        "block": {
            "status": None if block is None else block.status.name.lower(),
            "seq": None if block is None else block.seq,
            "acknowledged": block is not None,
            "reason": loop.refusal or loop.block_reason,
        },
        "waiting": loop.waiting,
        "filled": loop.filled,
        "estimates": loop.estimates,
        "dropped_estimates": loop.dropped_estimates,
    }


def stored_status(site: Site) -> Document:
    """Return what the store knows of a site without a running daemon.

    Of each table the newest rows only: a month of a large site is millions of estimates.

    Raises:
        StoreError: there is no historian to read.
    """
    from fieldlink.store import FleetReader, last_events, open_findings

    url = site.historian_url
    said: dict[str, EventRecord] = {}
    for event in last_events(url, _DEVICE_EVENTS):
        said[event.source] = event
    with FleetReader(url) as store:
        counts = store.slot_counts()
        loops = [_stored_loop(site, name, counts.get(name, {}), store) for name in site.loops]
        stamps = store.last_stored()
    devices = []
    for name in dict.fromkeys(loop.device for loop in site.loops.values()):
        last = said.get(name)
        devices.append(
            {
                "name": name,
                "state": "unknown" if last is None else last.kind.removeprefix("device."),
                "requests": None,
                "exceptions": None,
                "late": sum(counts[one]["late"] for one in site.loops_of(name) if one in counts),
                "missed": sum(loop["missed"] for loop in loops if loop["device"] == name),
                "reason": "" if last is None else last.message,
            }
        )
    # A daemon that nothing happens to stores judgements and counts, and no events. Stamps of a
    # clock that was ahead tell nothing.
    now_ms = 1000.0 * time.time()
    since = max([one for one in stamps if one <= now_ms] or stamps, default=None)
    return {
        "devices": devices,
        "loops": loops,
        "findings": [finding_document(one) for one in open_findings(url)],
        "daemon": {"alive": False, "since": None if since is None else time_text(since / 1000.0)},
        "store": None,
    }


def _stored_loop(site: Site, name: str, counts: Mapping[str, int], store: FleetReader) -> Document:
    found = next(iter(store.documents(name)), None)
    wrote = store.last_write(name)
    accepted = store.last_write(name, WritebackOutcome.ACCEPTED.code)
    diagnosis = store.diagnosis(name)
    bands = ("stick_band", "stick_band_low", "stick_band_high")
    return {
        "name": name,
        "device": site.loops[name].device,
        "expected": counts.get("expected", 0),
        "read": counts.get("read", 0),
        "bad": counts.get("bad", 0),
        "fault": "",
        "missed": counts.get("missed", 0),
        "verdict": None if found is None else found["verdict"],
        **{key: None if found is None else found[key] for key in bands},
        "block": {
            "status": None if accepted is None else accepted["status"],
            "seq": None if accepted is None else accepted["seq"],
            "acknowledged": accepted is not None,
            "reason": "" if wrote is None else wrote["reason"],
        },
        "waiting": None,
        "cause": None if diagnosis is None else diagnosis["cause"],
    }


def finding_document(found: FindingRecord) -> Document:
    """Return a finding as ``fieldlink status --json`` prints it."""
    return {
        "finding": found.finding,
        "state": found.state,
        "cause": found.cause,
        "loop": found.loop or None,
        "loops": list(found.loops),
        "swing_period_s": found.swing_period_s,
        "weight": found.weight,
        "born": time_text(found.born_ms / 1000.0),
        "text": describe_finding(found),
        "action": str((found.document or {}).get("action", "")),
    }


def event_document(record: EventRecord) -> Document:
    """Return an event as ``fieldlink events --json`` prints it."""
    return {
        "time": time_text(0.001 * record.utc_ms),
        "event": record.kind,
        "source": record.source,
        "message": record.message,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
