"""A trial of a site: its devices are polled for a minute; nothing is written, judged or stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldlink.daemon.devices_at_work import DevicesAtWork
from fieldlink.daemon.sampling.tasks import wait_for_end
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.links import SystemClock
from fieldlink.site import Site
from fieldlink.site.role_evidence import RoleEvidence, Roles, judge_roles
from fieldlink.store import Record, SampleRecord, StoreReport

__all__ = ["TRIAL", "LoopTrial", "try_site"]

TRIAL = 60.0
"""Seconds of a trial: sixty samples of a usual loop, and no window."""


BAD_SHARE = 0.1
"""Share of samples that may be missed or bad in a trial, the connecting at its begin included."""


@dataclass(frozen=True, slots=True)
class LoopTrial:
    """The outcome of one loop.

    Attributes:
        expected, read, missed, bad: samples.
        evidence: what its data say of OP and PV.
        reason: why its device does not answer; empty when it does.
    """

    expected: int
    read: int
    missed: int
    bad: int
    evidence: RoleEvidence
    reason: str

    @property
    def looks_swapped(self) -> bool:
        """Whether the data say that OP is PV."""
        return self.evidence.roles is Roles.SWAPPED

    @property
    def is_good(self) -> bool:
        """Whether it may run like this: nearly every sample came, and with a value."""
        came = self.read > 0 and self.missed + self.bad <= BAD_SHARE * self.expected
        return came and not self.looks_swapped


async def try_site(site: Site, seconds: float = TRIAL) -> dict[str, LoopTrial]:
    """Poll a site for so many seconds, read-only; return the outcome of each loop.

    Raises:
        FieldlinkError: a link cannot ever work.
    """
    records: list[Record] = []
    clock = SystemClock()
    site_runner = SiteRunner(site, clock, records.append, read_only=True)
    devices = DevicesAtWork(clock, site_runner.journal)
    failed = devices.watch()
    await site_runner.open()
    try:
        devices.begin_all(site_runner.runners.values())
        await wait_for_end(None, seconds, [failed])
        await devices.end(devices.tasks.values())
        devices.account_for_open_slots()
        status = site_runner.status(StoreReport())
    finally:
        devices.stop_watching()
        await site_runner.close()
    samples: dict[str, list[SampleRecord]] = {name: [] for name in status.loops}
    for record in records:
        if isinstance(record, SampleRecord):
            samples[record.loop].append(record)
    return {
        name: LoopTrial(
            loop.counts.expected,
            loop.counts.read,
            loop.counts.missed,
            loop.counts.bad,
            judge_roles(_values(samples[name], "op"), _values(samples[name], "pv")),
            status.devices[loop.device].last_failure if not loop.counts.read else "",
        )
        for name, loop in status.loops.items()
    }


def _values(samples: Sequence[SampleRecord], signal: str) -> NDArray[np.float64]:
    """Return a signal of the samples, NaN where it is bad."""
    return np.array([getattr(sample, signal) for sample in samples], float)
