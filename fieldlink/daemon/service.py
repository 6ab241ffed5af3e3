"""The live daemon: polls on monotonic deadlines, judges windows, writes back, until it is stopped.

Every device has two tasks of its own (`fieldlink.daemon.sampling.tasks`), so a silent device delays
no other and a slow write delays no poll. Windows are judged in other processes on the
scheduler's beat; records go to a thread. The event loop itself only waits. A changed site file is
taken over while all this runs, device by device.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from functools import partial

from fieldlink.daemon.devices_at_work import DevicesAtWork
from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.diagnosis.scheduled_rounds import ScheduledRounds
from fieldlink.daemon.estimation.judging import WindowJudging
from fieldlink.daemon.estimation.pool import PoolSettings
from fieldlink.daemon.installation import only_daemon
from fieldlink.daemon.operators.orders import Order
from fieldlink.daemon.operators.requests import OperatorRequests
from fieldlink.daemon.outgoing import Outgoing
from fieldlink.daemon.reloading.site_change import FileWatch
from fieldlink.daemon.reloading.site_takeover import SiteTakeover
from fieldlink.daemon.reporting.control_socket import control_socket
from fieldlink.daemon.reporting.scheduled_report import REPORT_LOOK, ScheduledReport
from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.reporting.status_documents import live_status
from fieldlink.daemon.sampling.clock_watch import ClockWatch, follow_clock
from fieldlink.daemon.sampling.slot_accounts import ACCOUNT_EVERY, SlotAccounts
from fieldlink.daemon.sampling.tasks import spawn, wait_for, wait_for_end
from fieldlink.daemon.schedule import Schedule
from fieldlink.daemon.settings import pool_settings_of, retention_of
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.links import Clock, SystemClock
from fieldlink.site import Site, load_site
from fieldlink.store import (
    Historian,
    HistorianSettings,
    Writer,
)

__all__ = ["Daemon"]

WATCH_EVERY = 1.0
"""Seconds between two looks at the site's files."""

TIDY_EVERY = 3600.0
"""Seconds between two applications of the store's retention."""


class Daemon:
    """Runs a site against its real devices.

    Args:
        site: the site.
        read_only: never write to any device, whatever the site file says.
        store: sizes and patience of the historian.
        pool: size and patience of the estimator's processes; the site file's unless given.
        clock: stamps readings and gives the deadlines.
        reread: gives the site again for a reload; reads its file unless given.
        watch_files: reload by itself when a file of the site has changed.

    Attributes:
        started: set once the devices are being polled.
    """

    def __init__(
        self,
        site: Site,
        *,
        read_only: bool = False,
        store: HistorianSettings | None = None,
        pool: PoolSettings | None = None,
        clock: Clock | None = None,
        reread: Callable[[], Site] | None = None,
        watch_files: bool = False,
    ) -> None:
        self._site = site
        self._data_dir = site.data_dir
        self._read_only = read_only
        self._since = 0.0
        self._clock = clock or SystemClock()
        self._historian = Historian(site.historian_url, store, retention=retention_of(site))
        self._clock_watch = ClockWatch(self._clock)
        self._outgoing = Outgoing(self._historian)
        self._runner = SiteRunner(
            site,
            self._clock,
            self._outgoing.put,
            read_only=read_only,
            live=True,
            watch=self._clock_watch,
            keep=self._historian.keep,
        )
        self._schedule: Schedule | None = None
        self._judging = WindowJudging(self._runner, pool or pool_settings_of(site))
        self._requests = OperatorRequests(
            self._runner, self._judging, self._clock, read_only=read_only
        )
        self._outgoing.open(site, self._runner, self._requests, self._clock)
        self._devices = DevicesAtWork(self._clock, self._runner.journal)
        self._takeover = SiteTakeover(
            reread or partial(load_site, site.path),
            self._runner,
            self._devices,
            self._judging,
            self._clock,
        )
        self._watch_files = watch_files
        self._wanted = asyncio.Event()
        rounds = DiagnosisRounds(
            lambda: self._runner.runners,
            self._outgoing.put,
            self._runner.journal,
            self._clock,
            site.historian_url,
        )
        self._rounds = ScheduledRounds(
            rounds, self._judging, self._runner.journal, lambda: self._site
        )
        self.started = asyncio.Event()

    @property
    def site(self) -> Site:
        """The site that is in force now."""
        return self._site

    @property
    def since(self) -> float:
        """When the daemon began, seconds since 1970; 0 before that."""
        return self._since

    def status(self) -> DaemonStatus:
        """Return a snapshot; may be called at any time."""
        return self._runner.status(
            self._historian.report(),
            self._judging.report(),
            reloads=self._takeover.accepted,
            refused=self._takeover.refused,
            upward=self._outgoing.upward(),
            findings=self._rounds.report(),
            notices=self._outgoing.notices(),
        )

    def stuck(self) -> tuple[str, ...]:
        """Name what should be at work and is not; empty while all is well."""
        store = self.started.is_set() and not self._historian.alive
        return (*self._devices.stuck(), *(("store",) if store else ()))

    def reload_soon(self) -> None:
        """Let the site file be read again; returns at once. What comes of it is an event."""
        self._wanted.set()

    async def run(
        self, duration: float | None = None, stop: asyncio.Event | None = None
    ) -> DaemonStatus:
        """Run until ``stop`` is set or ``duration`` wall seconds have passed.

        Returns:
            The last status.

        Raises:
            InUseError: another daemon has the data directory.
            StoreError: the historian cannot be opened, or another daemon writes one of the loops.
            FieldlinkError: a link that cannot ever work.
        """
        with only_daemon(self._site.data_dir) as identity:
            self._runner.identify(identity)
            return await self._run(identity, duration, stop)

    async def _run(
        self, identity: int, duration: float | None, stop: asyncio.Event | None
    ) -> DaemonStatus:
        journal = self._runner.journal
        self._since = self._clock.utc()
        begun = journal.event_record("daemon.start", "daemon", self._site.name)
        loops = frozenset(self._site.loops)
        writer = Writer(self._data_dir.absolute(), identity, loops, begun.utc_ms)
        # It may wait for a writer before it that ended without a word.
        await asyncio.to_thread(self._historian.start, begun, writer)
        try:
            await self._runner.resume_from(self._site.historian_url)
            await self._rounds.resume()
            self._judging.open()
            try:
                await self._runner.open()
                async with (
                    self._outgoing.running() as sending,
                    self._at_work() as failures,
                    control_socket(self._data_dir, self._answer),
                ):
                    self.started.set()
                    await wait_for_end(stop, duration, [*failures, *sending])
            finally:
                await self._runner.close()
                await self._judging.close()
        except BaseException as error:
            journal.event("daemon.failed", "daemon", repr(error), bad=True)
            raise
        else:
            journal.event("daemon.stop", "daemon", "stopped as asked")
        finally:
            await asyncio.to_thread(self._historian.stop)
        return self.status()

    def carry_out(self, order: Order) -> str:
        """Carry out an operator's order and record it; return in words what follows.

        Raises:
            OrderError: there is no such loop, or the order cannot be carried out.
        """
        return self._requests.carry_out(order)

    def _answer(self, request: Mapping[str, object]) -> Mapping[str, object]:
        """Answer a request that came through the control socket."""
        if request.get("command") == "status":
            return live_status(self.status(), self._since)
        return self._requests.answer(request)

    @asynccontextmanager
    async def _at_work(self) -> AsyncIterator[list[asyncio.Future[None]]]:
        """Start everything; yield what must not end by itself; end it in order."""
        failed = self._devices.watch()
        schedule = self._schedule = Schedule()
        accounts = SlotAccounts(self._historian.put, self._clock)
        warming = spawn(self._judging.warm_up(), "warm-up")
        self._devices.begin_all(self._runner.runners.values())
        for runner in self._runner.runners.values():
            self._judging.begin(runner, schedule)
        schedule.every(ACCOUNT_EVERY, "slot accounts", self._do(self._account, accounts))
        schedule.every(TIDY_EVERY, "retention", self._do(self._historian.tidy))
        reports = ScheduledReport(self._runner.journal)
        schedule.every(REPORT_LOOK, "report", partial(self._report, reports))
        self._rounds.follow(schedule)
        self._historian.tidy()
        schedule.start()
        watching = [
            spawn(follow_clock(self._clock_watch, schedule, self._runner.journal), "clock"),
            spawn(self._watch_site(schedule), "site"),
        ]
        try:
            yield [schedule.failed, failed, *watching]
        finally:
            self._judging.stop()
            self._rounds.stop()
            schedule.pause()
            for task in (warming, *watching):
                task.cancel()
            await asyncio.gather(warming, *watching, return_exceptions=True)
            await self._devices.end(self._devices.tasks.values(), self._judging.tasks)
            self._devices.account_for_open_slots()
            self._account(accounts)
            schedule.stop()
            self._devices.stop_watching()

    async def _watch_site(self, schedule: Schedule) -> None:
        """Take over the site file when that is asked for, or when a file has changed."""
        watch = FileWatch(self._site)
        while True:
            asked = await wait_for(self._wanted, WATCH_EVERY)
            self._wanted.clear()
            changed = self._watch_files and watch.changed()
            if asked or changed:
                watch.accept()
                site = await self._takeover.take_over(self._site, schedule)
                if site is not self._site:
                    self._outgoing.follow(site)
                    self._historian.follow(site.loops)
                self._site = site
                self._rounds.follow(schedule)
                watch.follow(self._site)

    def _account(self, accounts: SlotAccounts) -> None:
        accounts.close(self._runner.counts())

    def _do(self, work: Callable[..., None], *arguments: object) -> Callable[[], Awaitable[None]]:
        async def job() -> None:
            try:
                work(*arguments)
            except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
                self._runner.journal.defect("daemon", error, "it is tried again at its time")

        return job

    async def _report(self, reports: ScheduledReport) -> None:
        try:
            await reports.write_due(self._site)
        except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
            self._runner.journal.defect("daemon", error, "it is tried again at its time")
