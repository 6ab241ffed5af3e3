"""A snapshot of the daemon for a live view, a report or a health check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.estimation.estimating import Estimate
from fieldlink.daemon.estimation.pool import PoolReport
from fieldlink.daemon.sampling.lateness import LatenessReport
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.links import LinkState
from fieldlink.notices import NoticesReport
from fieldlink.registers import ParameterBlock
from fieldlink.store import SampleRecord, StoreReport
from fieldlink.upward import UpwardReport

__all__ = ["DaemonStatus", "DeviceStatus", "LoopStatus"]


@dataclass(frozen=True, slots=True)
class LoopStatus:
    """One loop.

    Attributes:
        device: the device it is on.
        counts: of its samples, by outcome.
        filled: how much of the window is there, 0 to 1.
        samples_until_estimate: samples to come before the next estimate.
        latest: the newest sample, None before the first.
        fault: which tags of it are bad, and why; empty when it is good.
        estimates: estimates made.
        last_estimate: the newest one.
        attempts: write-back attempts and decisions; outcomes: how many came to what, by code.
        last_attempt: the newest one; last_accepted: the newest block that the PLC acknowledged.
        idle: plant seconds since the newest sample, or since the first poll.
        dropped_estimates: estimates that came after the site file had changed.
        waiting: what waits to be written, and why; None when nothing does.
        refusal: why the PLC's controller does not use the accepted model; empty when it does.
        unused: why it does not use a model that it does not refuse; empty when it does.
        block: the last block that the PLC acknowledges, as far as known.
        in_use: whether the PLC's controller uses that block; None before the first look.
        may_write: whether the site file lets the loop be written.
        hold, off: the operator's standing orders, in words; empty when there is none.
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
    outcomes: Mapping[str, int] = field(default_factory=dict)
    fault: str = ""
    idle: float = 0.0
    dropped_estimates: int = 0
    waiting: str | None = None
    refusal: str = ""
    unused: str = ""
    block: ParameterBlock | None = None
    in_use: bool | None = None
    may_write: bool = False
    hold: str = ""
    off: str = ""

    @property
    def block_reason(self) -> str:
        """Why the block is not used, else why the last write-back ended as it did."""
        if self.unused:
            return self.unused
        last = self.last_attempt
        if last is None:
            return ""
        if self.block is None and last.outcome is WritebackOutcome.ACCEPTED:
            return "the PLC has accepted a block and acknowledges none now: see writeback.lost"
        return last.why


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """One device.

    Attributes:
        state: how it answers.
        polls: scans made; late: poll slots skipped because the one before took too long.
        requests: requests sent, those of the write-back included.
        failures: errors met while scanning; last_failure: the newest, empty when there was none.
        plant_time: plant seconds since the start.
        lateness: of the replies that carried samples.
        connects: times the connection was opened; late_replies: replies that came after their
            time-out and were passed over.
        quarantined: tags that are left out for now because the device refuses their registers.
    """

    state: LinkState
    polls: int
    late: int
    requests: int
    failures: int
    last_failure: str
    plant_time: float
    lateness: LatenessReport = field(default_factory=LatenessReport)
    connects: int = 0
    late_replies: int = 0
    quarantined: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DaemonStatus:
    """Everything at one moment.

    Attributes:
        devices, loops: by name.
        store: records written, lost and waiting.
        pool: what the estimator's processes have done.
        clock_steps: times the wall clock was seen to step.
        reloads: site files taken over while running; refused: those that were wrong.
        defects: unforeseen errors; the log shows where.
        upward: messages delivered to the broker and waiting; None where the site publishes nothing.
        findings: why loops swing; None where the site switches the diagnosis off.
        notices: notices delivered and waiting; None where none are configured.
    """

    devices: Mapping[str, DeviceStatus]
    loops: Mapping[str, LoopStatus]
    store: StoreReport
    pool: PoolReport = field(default_factory=PoolReport)
    clock_steps: int = 0
    reloads: int = 0
    refused: int = 0
    defects: int = 0
    upward: UpwardReport | None = None
    findings: FindingsReport | None = None
    notices: NoticesReport | None = None

    @property
    def pool_rebuilt(self) -> int:
        """Times the estimator's processes were replaced."""
        return self.pool.rebuilt

    @property
    def requests(self) -> int:
        """Requests sent to all devices."""
        return sum(device.requests for device in self.devices.values())

    @property
    def late_slots(self) -> int:
        """Poll slots skipped on all devices."""
        return sum(device.late for device in self.devices.values())
