"""The daemon: scans into windows, windows into findings, findings into the PLC's blocks."""

from fieldlink.daemon.estimating import Estimate, EstimateOutcome, Findings, Interval
from fieldlink.daemon.lateness import BOUNDS as LATENESS_BOUNDS
from fieldlink.daemon.lateness import LatenessReport
from fieldlink.daemon.lockstep import LockstepRun
from fieldlink.daemon.logs import configure_logging
from fieldlink.daemon.notify import Notifier, supervised
from fieldlink.daemon.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.pool import PoolReport, PoolSettings
from fieldlink.daemon.service import Daemon
from fieldlink.daemon.signals import reload_on_hangup, stop_on_signals
from fieldlink.daemon.status import DaemonStatus, DeviceStatus, LoopStatus

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
    "reload_on_hangup",
    "stop_on_signals",
    "supervised",
]
