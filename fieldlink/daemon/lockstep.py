"""The same site in lockstep with simulated plants: no waiting, no network, repeatable.

Scans, windows, write-back and journal are those of the live daemon; only the clock stands still
between scans, and windows are judged inline. A run is the same for the same seed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from fieldlink.daemon.assembly import Assembly, OpenLink
from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.estimation.answers import InlineWorker
from fieldlink.daemon.estimation.estimating import Estimator, InlineEstimator
from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.settings import retention_of
from fieldlink.errors import FieldlinkError
from fieldlink.links import Link, SteppedLink, VirtualClock, open_link
from fieldlink.site import Site
from fieldlink.store import Historian, Record, StoreReport

__all__ = ["LockstepRun"]

_YIELD_EVERY = 64
"""Scans between two chances for other tasks of the event loop."""


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
        self._assembly = Assembly(
            site, self._clock, self._put, read_only=read_only, live=False, links=links
        )
        self._rounds = DiagnosisRounds(
            lambda: self._assembly.runners,
            self._put,
            self._assembly.journal,
            self._clock,
            site.historian_url if store else None,
        )

    def link(self, device: str) -> Link:
        """Return the link of a device, for judging a run by what the plant really did."""
        return self._assembly.runners[device].link

    def status(self) -> DaemonStatus:
        """Return a snapshot; may be called at any time."""
        report = StoreReport() if self._historian is None else self._historian.report()
        table = self._site.file.findings
        return self._assembly.status(
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
        journal = self._assembly.journal
        if self._historian is not None:
            self._historian.start(journal.event_record("lockstep.start", "daemon", self._site.name))
            self._historian.tidy()
        await self._rounds.resume()
        try:
            await self._assembly.open()
            try:
                await self._steps(duration, on_scan, stop)
            finally:
                await self._assembly.close()
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
        periods = {name: _period(runner) for name, runner in self._assembly.runners.items()}
        scans = dict.fromkeys(periods, 0)
        total = 0
        table = self._site.file.findings
        rounds = 1
        while periods and not (stop is not None and stop.is_set()):
            name = min(periods, key=lambda name: scans[name] * periods[name])
            now = scans[name] * periods[name]
            if now >= duration:
                return
            self._clock.advance_to(now)
            if table.enabled and now >= rounds * table.every:
                rounds = int(now // table.every) + 1
                await self._rounds.run(self._site, InlineWorker())
            await self._step(self._assembly.runners[name], now)
            scans[name] += 1
            total += 1
            if self._assembly.runners[name].ended:
                del periods[name]
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
