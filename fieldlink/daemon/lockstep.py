"""The same site in lockstep with simulated plants: no waiting, no network, repeatable.

Scans, windows, write-back and journal are those of the live daemon; only the clock stands still
between scans, and windows are judged inline. A run is the same for the same seed.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.estimation.answers import InlineWorker
from fieldlink.daemon.estimation.estimating import Estimator, InlineEstimator
from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.settings import retention_of
from fieldlink.daemon.site_runner import OpenLink, SiteRunner
from fieldlink.errors import FieldlinkError
from fieldlink.links import GoesOn, Link, SteppedLink, VirtualClock, open_link
from fieldlink.registers import HEARTBEAT_EVERY
from fieldlink.site import Site
from fieldlink.store import Historian, Record, StoreReport

__all__ = ["LockstepRun"]

LOOK_EVERY = 0.5 * HEARTBEAT_EVERY
"""Plant seconds between two looks of the write-backs, as in the live daemon (`DeviceTasks`)."""

_YIELD_EVERY = 64
"""Scans after which other tasks of the event loop may run."""


class LockstepRun:
    """Runs a site whose devices are simulations or recordings.

    Args:
        site: the site; every device with a loop needs a link that is moved by its scans.
        store: keep records in the site's historian.
        read_only: never write to any device.
        estimator: who judges the windows.
        start_utc: the UTC second at which the simulated time begins.
        on_record: called with every record, for tests and pictures.
        links: makes the link of each device.
    """

    def __init__(
        self,
        site: Site,
        *,
        store: bool = False,
        read_only: bool = False,
        estimator: Estimator | None = None,
        start_utc: float = 0.0,
        on_record: Callable[[Record], None] | None = None,
        links: OpenLink = open_link,
    ) -> None:
        self._site = site
        self._clock = VirtualClock(start_utc)
        self._historian = (
            Historian(site.historian_url, retention=retention_of(site)) if store else None
        )
        self._on_record = on_record
        self._estimator = estimator or InlineEstimator()
        self._runner = SiteRunner(
            site, self._clock, self._put, read_only=read_only, live=False, links=links
        )
        self._rounds = DiagnosisRounds(
            lambda: self._runner.runners,
            self._put,
            self._runner.journal,
            self._clock,
            site.historian_url if store else None,
        )

    def link(self, device: str) -> Link:
        """Return the link of a device, for judging a run by what the plant really did."""
        return self._runner.runners[device].link

    def status(self) -> DaemonStatus:
        """Return a snapshot; may be called at any time."""
        report = StoreReport() if self._historian is None else self._historian.report()
        table = self._site.file.findings
        return self._runner.status(
            report, findings=self._rounds.report() if table.enabled else None
        )

    async def run(
        self,
        duration: float,
        on_scan: Callable[[float], None] | None = None,
        stop: asyncio.Event | None = None,
    ) -> DaemonStatus:
        """Run for ``duration`` plant seconds, or until every recording has ended or ``stop``.

        Args:
            duration: plant seconds.
            on_scan: called with the plant second after every scan.
            stop: ends the run early.

        Raises:
            FieldlinkError: a device is not a simulation, or cannot be opened.
            StoreError: the historian cannot be opened.
        """
        journal = self._runner.journal
        if self._historian is not None:
            self._historian.start(journal.event_record("lockstep.start", "daemon", self._site.name))
            self._historian.tidy()
        await self._rounds.resume()
        try:
            await self._runner.open()
            try:
                await self._steps(duration, on_scan, stop)
            finally:
                await self._runner.close()
        finally:
            if self._historian is not None:
                await asyncio.to_thread(self._historian.stop)
        return self.status()

    async def _steps(
        self,
        duration: float,
        on_scan: Callable[[float], None] | None,
        stop: asyncio.Event | None,
    ) -> None:
        steps = {name: _Steps(runner) for name, runner in self._runner.runners.items()}
        total = 0
        table = self._site.file.findings
        rounds = 1
        while steps and not (stop is not None and stop.is_set()):
            name = min(steps, key=lambda name: steps[name].next)
            device = steps[name]
            now = device.next
            if now >= duration:
                return
            self._clock.advance_to(now)
            if not device.is_scan:
                await device.look()
                continue
            if table.enabled and now >= rounds * table.every:
                rounds = int(now // table.every) + 1
                await self._rounds.run(lambda: self._site, InlineWorker())
            await self._step(device.runner, now)
            device.note_scan()
            total += 1
            if device.runner.ended:
                del steps[name]
            if on_scan is not None:
                on_scan(now)
            if total % _YIELD_EVERY == 0:
                await asyncio.sleep(0)

    async def _step(self, runner: DeviceRunner, now: float) -> None:
        await runner.poll(now)
        for loop in runner.loops.values():
            if loop.pipeline.samples_until_estimate == 0:
                request = loop.request()
                loop.accept(await self._estimator.run(request), request)
        await runner.service(now)

    def _put(self, record: Record) -> None:
        if self._historian is not None:
            self._historian.put(record, wait=True)
        if self._on_record is not None:
            self._on_record(record)


def _period(runner: DeviceRunner) -> float:
    if not isinstance(runner.link, SteppedLink):
        raise FieldlinkError(
            f"device {runner.name!r} keeps its own time and cannot run in lockstep; "
            'use link = "fmu" or link = "recording", or the live daemon'
        )
    return runner.link.scan_period


class _Steps:
    """What a device does next: a scan on its period, or the write-backs' look in between.

    The live daemon lets write-backs look on a beat of their own, so that the heartbeat counts
    whatever the polling period is; the PLC's block reader watches the heartbeat meanwhile.
    """

    def __init__(self, runner: DeviceRunner) -> None:
        self.runner = runner
        self._period = _period(runner)
        self._scans = self._looks = 0

    @property
    def next(self) -> float:
        """Plant second of what comes next."""
        return self._next_scan if self.is_scan else self._looks * LOOK_EVERY

    @property
    def is_scan(self) -> bool:
        """Whether a scan comes next; it takes the place of a look at the same moment."""
        return not self.runner.writes or self._next_scan <= self._looks * LOOK_EVERY

    @property
    def _next_scan(self) -> float:
        return self._scans * self._period

    def note_scan(self) -> None:
        """Note that the next scan is done."""
        self._looks = math.floor(self._next_scan / LOOK_EVERY) + 1
        self._scans += 1

    async def look(self) -> None:
        """Let the PLC watch its blocks, then the write-backs do what is due."""
        now = self.next
        link = self.runner.link
        if isinstance(link, GoesOn):
            link.go_on(now - (self._scans - 1) * self._period)
        self._looks += 1
        await self.runner.service(now)
