"""A snapshot of the daemon for a live view, a report or a health check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fieldlink.daemon.estimating import Estimate
from fieldlink.daemon.outcomes import Attempt
from fieldlink.daemon.pipeline import LoopCounts
from fieldlink.links import LinkState
from fieldlink.store import SampleRecord, StoreReport

__all__ = ["DaemonStatus", "DeviceStatus", "LoopStatus"]


@dataclass(frozen=True, slots=True)
class LoopStatus:
    """One loop.

    Attributes:
        device: the device it is on.
        counts: what became of its samples.
        filled: how much of the window is there, 0 to 1.
        samples_until_estimate: samples to come before the next estimate.
        latest: the newest sample, None before the first.
        estimates: estimates made.
        last_estimate: the newest one.
        attempts: write-back attempts and decisions.
        last_attempt: the newest one; last_accepted: the newest block that the PLC acknowledged.
    """

    device: str
    counts: LoopCounts
    filled: float
    samples_until_estimate: int
    latest: SampleRecord | None
    estimates: int
    last_estimate: Estimate | None
    attempts: int
    last_attempt: Attempt | None
    last_accepted: Attempt | None


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """One device.

    Attributes:
        state: how it answers.
        polls: scans made; late: poll slots skipped because the one before took too long.
        requests: requests sent, those of the write-back included.
        failures: errors met while scanning; last_failure: the newest, empty when there was none.
        plant_time: plant seconds since the start.
    """

    state: LinkState
    polls: int
    late: int
    requests: int
    failures: int
    last_failure: str
    plant_time: float


@dataclass(frozen=True, slots=True)
class DaemonStatus:
    """Everything at one moment.

    Attributes:
        devices, loops: by name.
        store: what became of the records.
        pool_rebuilt: times the estimator's processes were replaced.
    """

    devices: Mapping[str, DeviceStatus]
    loops: Mapping[str, LoopStatus]
    store: StoreReport
    pool_rebuilt: int = 0

    @property
    def requests(self) -> int:
        """Requests sent to all devices."""
        return sum(device.requests for device in self.devices.values())

    @property
    def late_slots(self) -> int:
        """Poll slots skipped on all devices."""
        return sum(device.late for device in self.devices.values())
