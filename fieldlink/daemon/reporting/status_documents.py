"""What ``fieldlink status`` and ``fieldlink events`` show: plain JSON types, null for unknown.

`live_status` tells of a running daemon, `stored_status` what the store knows without one.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.reporting.status import DaemonStatus, DeviceStatus, LoopStatus
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.findings import describe_finding
from fieldlink.site import Site
from fieldlink.store import EventRecord, FindingRecord

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["event_document", "finding_document", "live_status", "stored_status", "time_text"]

Document = dict[str, Any]


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

    Raises:
        StoreError: there is no historian to read.
    """
    from fieldlink.store import (
        FleetReader,
        open_findings,
        read_estimates,
        read_events,
        read_slots,
        read_writebacks,
    )

    url = site.historian_url
    events, slots = read_events(url), read_slots(url)
    estimates, blocks = read_estimates(url), read_writebacks(url)
    loops = [_stored_loop(site, name, slots, estimates, blocks) for name in site.loops]
    devices = []
    for name in dict.fromkeys(loop.device for loop in site.loops.values()):
        mine = events[(events["source"] == name) & events["kind"].str.startswith("device.")]
        last = None if mine.empty else mine.iloc[-1]
        devices.append(
            {
                "name": name,
                "state": "unknown" if last is None else str(last["kind"]).removeprefix("device."),
                "requests": None,
                "exceptions": None,
                "late": _total(slots[slots["loop"].isin(site.loops_of(name))], "late"),
                "missed": sum(loop["missed"] for loop in loops if loop["device"] == name),
                "reason": "" if last is None else str(last["message"]),
            }
        )
    # A daemon that nothing happens to stores judgements and counts, and no events.
    tables = (events, slots, estimates, blocks)
    since = max((t["time"].max().timestamp() for t in tables if not t.empty), default=None)
    with FleetReader(url) as store:
        for loop in loops:
            diagnosis = store.diagnosis(loop["name"])
            loop["cause"] = None if diagnosis is None else diagnosis["cause"]
    return {
        "devices": devices,
        "loops": loops,
        "findings": [finding_document(one) for one in open_findings(url)],
        "daemon": {"alive": False, "since": None if since is None else time_text(since)},
    }


def _stored_loop(
    site: Site, name: str, slots: pd.DataFrame, estimates: pd.DataFrame, blocks: pd.DataFrame
) -> Document:
    mine = slots[slots["loop"] == name]
    found = estimates[(estimates["loop"] == name) & estimates["verdict"].notna()]
    wrote = blocks[blocks["loop"] == name]
    accepted = wrote[wrote["outcome"] == WritebackOutcome.ACCEPTED.code]
    return {
        "name": name,
        "device": site.loops[name].device,
        "expected": _total(mine, "expected"),
        "read": _total(mine, "read"),
        "bad": _total(mine, "bad"),
        "fault": "",
        "missed": _total(mine, "missed"),
        "verdict": None if found.empty else found["verdict"].iloc[-1],
        **{
            key: None if found.empty else _number(found[key].iloc[-1])
            for key in ("stick_band", "stick_band_low", "stick_band_high")
        },
        "block": {
            "status": None if accepted.empty else accepted["status"].iloc[-1],
            "seq": None if accepted.empty else int(accepted["seq"].iloc[-1]),
            "acknowledged": not accepted.empty,
            "reason": "" if wrote.empty else wrote["reason"].iloc[-1],
        },
        "waiting": None,
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


def _total(rows: pd.DataFrame, column: str) -> int:
    return int(rows[column].sum())


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
