"""The daemon: scans into windows, windows into findings, findings into the PLC's blocks.

All timing lives here; numerics run in processes of their own, and HTTP and pages in `web`.
"""

from fieldlink.daemon.estimation.estimating import Estimate, EstimateOutcome, Findings, Interval
from fieldlink.daemon.estimation.pool import PoolReport, PoolSettings
from fieldlink.daemon.installation import only_daemon
from fieldlink.daemon.lockstep import LockstepRun
from fieldlink.daemon.process_signals import reload_on_hangup, stop_on_signals
from fieldlink.daemon.reporting.logs import configure_logging
from fieldlink.daemon.reporting.status import DaemonStatus, DeviceStatus, LoopStatus
from fieldlink.daemon.reporting.systemd_notify import Notifier, supervised
from fieldlink.daemon.sampling.lateness import BOUNDS as LATENESS_BOUNDS
from fieldlink.daemon.sampling.lateness import LatenessReport
from fieldlink.daemon.service import Daemon
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome

__all__ = [
    "LATENESS_BOUNDS",
    "Attempt",
    "Daemon",
    "DaemonStatus",
    "DeviceStatus",
    "Estimate",
    "EstimateOutcome",
    "Findings",
    "Interval",
    "LatenessReport",
    "LockstepRun",
    "LoopStatus",
    "Notifier",
    "PoolReport",
    "PoolSettings",
    "WritebackOutcome",
    "configure_logging",
    "only_daemon",
    "reload_on_hangup",
    "stop_on_signals",
    "supervised",
]
