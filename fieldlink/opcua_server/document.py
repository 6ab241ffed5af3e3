"""What the server shows, as plain data: the fleet of the operators' pages and the devices."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from fieldlink.daemon import DaemonStatus
from fieldlink.links import LinkState
from fieldlink.site import Site
from fieldlink.web.view.fleet_view import Fleet

__all__ = ["device_values", "loop_values"]

Values = dict[str, Any]
"""Value by browse name; None for what is not known, a list for a value that is uncertain."""

NORMAL, FAILURE, OFF_SPEC, MAINTENANCE_REQUIRED = 0, 1, 3, 4
"""Values of DeviceHealthEnumeration."""

_VALVE = {"stiction": MAINTENANCE_REQUIRED, "no_stiction": NORMAL}

_CONNECTION = {
    LinkState.GOOD: NORMAL,
    LinkState.DEGRADED: OFF_SPEC,
    LinkState.DEMOTED: FAILURE,
}

MOST_UINT32 = 0xFFFF_FFFF


def loop_values(fleet: Fleet) -> dict[str, Values]:
    """Return the values of every loop by its name."""
    return {row["name"]: _loop(row) for row in fleet.rows}


def _loop(row: Mapping[str, Any]) -> Values:
    stick_band, slip_jump, block = row["stick_band"], row["slip_jump"], row["block"]
    verdict = row["verdict"]
    health: int | list[Any] | None = _VALVE.get(verdict or "")
    if health is not None and row["uncertain"]:
        health = [health, "uncertain"]
    judged = row["estimated"]
    return {
        "AssetId": row["name"],
        "DeviceHealth": health,
        "Verdict": verdict,
        "Doubtful": None if verdict is None else row["uncertain"],
        "Score": row["score"],
        "StickBand": stick_band["value"],
        "StickBandLow": stick_band["low"],
        "StickBandHigh": stick_band["high"],
        "StickBandLimit": row["limit"],
        "SlipJump": slip_jump["value"],
        "SlipJumpLow": slip_jump["low"],
        "SlipJumpHigh": slip_jump["high"],
        "Confidence": row["confidence"],
        "TrendPerWeek": row["trend_per_week"],
        "DaysToLimit": row["days_to_limit"],
        "JudgedAt": None if judged is None else datetime.fromisoformat(judged).timestamp(),
        "Message": row["message"],
        "Compensated": row["compensated"],
        "BlockState": block["text"],
        "BlockReason": block["why"],
        "BlockSequence": block["seq"],
        "Device": row["device"],
        # Whole percents: a share that counts every sample would change at each of them.
        "DataQuality": None if row["quality"] is None else round(row["quality"], 2),
    }


def device_values(status: DaemonStatus, site: Site) -> dict[str, Values]:
    """Return the values of every device by its name."""
    missed = dict.fromkeys(status.devices, 0)
    for loop in status.loops.values():
        missed[loop.device] += loop.counts.missed
    return {
        name: {
            "ComponentName": name,
            "DeviceHealth": _CONNECTION.get(device.state),
            "State": device.state.name.lower(),
            "Reason": "" if device.state is LinkState.GOOD else device.last_failure,
            "Address": site.devices[name].where if name in site.devices else "",
            "Requests": device.requests & MOST_UINT32,
            "MissedSamples": missed[name] & MOST_UINT32,
        }
        for name, device in status.devices.items()
    }
