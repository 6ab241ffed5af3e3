"""The live daemon: polls on monotonic deadlines, judges windows, writes back, until told to stop.

Every device has two tasks of its own (`fieldlink.daemon.sampling.tasks`), so a silent device delays
nobody else and a slow write delays no poll. Windows are judged in other processes on the
scheduler's beat; records go to a thread. The event loop itself only waits. A changed site file is
taken over while all this runs, device by device.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from contextlib import asynccontextmanager
from functools import partial

from fieldlink.daemon.assembly import Assembly
from fieldlink.daemon.estimation.pool import EstimatorPool, PoolReport, PoolSettings
from fieldlink.daemon.installation import only_daemon
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.orders import (
    ORDER_EVENTS,
    Action,
    Order,
    OrderError,
    carry_out,
    recall_orders,
)
from fieldlink.daemon.reload import FileWatch, SiteChange
from fieldlink.daemon.reporting.control import control_socket
from fieldlink.daemon.reporting.documents import live_status
from fieldlink.daemon.reporting.scheduled_report import REPORT_LOOK, ScheduledReport
from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.sampling.accounts import ACCOUNT_EVERY, SlotAccounts
from fieldlink.daemon.sampling.clock_watch import CHECK_EVERY, ClockWatch
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.sampling.tasks import DeviceTasks, spawn, wait_for
from fieldlink.daemon.schedule import Schedule
from fieldlink.daemon.settings import pool_settings_of, retention_of
from fieldlink.errors import FieldlinkError
from fieldlink.links import Clock, SteppedLink, SystemClock
from fieldlink.site import Site, load_site
from fieldlink.store import (
    Historian,
    HistorianSettings,
    Record,
    StoreError,
    last_blocks,
    last_events,
)
from fieldlink.upward import Publishing

__all__ = ["Daemon"]

STOP_GRACE = 5.0
"""Seconds that windows being judged and writes under way have to finish when the daemon stops."""

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
        reread: gives the site anew for a reload; reads its file unless given.
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
        self._publishing: Publishing | None = None
        self._assembly = Assembly(
            site,
            self._clock,
            self._put,
            read_only=read_only,
            live=True,
            watch=self._clock_watch,
            keep=self._historian.keep,
        )
        self._publishing = self._way_upward(site)
        self._schedule: Schedule | None = None
        self._pool_settings = pool or pool_settings_of(site)
        self._pool: EstimatorPool | None = None
        self._reread = reread or partial(load_site, site.path)
        self._watch_files = watch_files
        self._wanted = asyncio.Event()
        self._judging: set[asyncio.Task[None]] = set()
        # Windows are copied when their turn is near, not all at once.
        self._turns = asyncio.Semaphore(2 * self._pool_settings.workers)
        self._devices: dict[str, DeviceTasks] = {}
        self._stopping = False
        self._failed: asyncio.Future[None] | None = None
        self._reloads = self._refused = 0
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
        return self._assembly.status(
            self._historian.report(),
            PoolReport() if self._pool is None else self._pool.report(),
            reloads=self._reloads,
            refused=self._refused,
            upward=None if self._publishing is None else self._publishing.report(),
        )

    def stuck(self) -> tuple[str, ...]:
        """Name what should be at work and is not; empty while all is well."""
        names = [f"device {name}" for name, tasks in self._devices.items() if tasks.stuck]
        if self.started.is_set() and not self._historian.alive:
            names.append("store")
        return tuple(names)

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
            StoreError: the historian cannot be opened.
            FieldlinkError: a link that cannot ever work.
        """
        with only_daemon(self._site.data_dir) as identity:
            self._assembly.identify(identity)
            return await self._run(duration, stop)

    async def _run(self, duration: float | None, stop: asyncio.Event | None) -> DaemonStatus:
        journal = self._assembly.journal
        self._since = self._clock.utc()
        self._historian.start(journal.event_record("daemon.start", "daemon", self._site.name))
        try:
            await self._resume_writebacks()
            self._pool = EstimatorPool(self._pool_settings)
            try:
                await self._assembly.open()
                async with (
                    self._upward() as sending,
                    self._at_work() as failures,
                    control_socket(self._data_dir, self._answer),
                ):
                    self.started.set()
                    await _until(stop, duration, [*failures, *sending])
            finally:
                await self._assembly.close()
                await self._pool.close()
        except BaseException as error:
            journal.event("daemon.failed", "daemon", repr(error), bad=True)
            raise
        else:
            journal.event("daemon.stop", "daemon", "stopped as asked")
        finally:
            await asyncio.to_thread(self._historian.stop)
        return self.status()

    def withdraw(self, name: str, reason: str) -> None:
        """Withdraw a loop's block at the next look.

        Raises:
            FieldlinkError: there is no such loop, or it may not be written.
        """
        loop = self._assembly.loop(name)
        if loop is None:
            raise FieldlinkError(f"the running daemon has no loop {name!r}; see fieldlink status")
        if self._read_only:
            raise FieldlinkError(
                "the running daemon writes nothing (--read-only); clear the PLC's enable bit"
            )
        loop.withdraw(reason, self._clock.utc())

    def carry_out(self, order: Order) -> str:
        """Carry out an operator's order and record it; return in words what follows.

        Raises:
            OrderError: there is no such loop, or the order cannot be carried out.
        """
        loop = self._assembly.loop(order.loop)
        if loop is None:
            raise OrderError(f"the running daemon has no loop {order.loop!r}")
        utc = self._clock.utc()
        if order.action is Action.ESTIMATE:
            self._judge_by_hand(loop)
        carry_out(order, loop, utc, read_only=self._read_only)
        self._assembly.journal.order(order.record(round(utc * 1000.0)))
        return order.action.done

    def _judge_by_hand(self, loop: LoopRunner) -> None:
        if self._pool is None or self._stopping:
            raise OrderError("the daemon is starting or stopping; try again in a moment")
        if loop.pipeline.filled < 1.0:
            raise OrderError(
                f"the window of loop {loop.name} is {loop.pipeline.filled:.0%} full; it is judged "
                "when it is full"
            )
        name = f"{_job(loop.name)} by hand"
        if any(task.get_name() == name for task in self._judging):
            raise OrderError(f"the window of loop {loop.name} is being judged already")
        self._judging.add(spawn(self._judge_window(loop.name, loop, by_hand=True), name))

    def _answer(self, request: Mapping[str, object]) -> Mapping[str, object]:
        """Answer a request that came through the control socket."""
        command = request.get("command")
        if command == "status":
            return live_status(self.status(), self._since)
        if command == "withdraw":
            self.withdraw(str(request.get("loop", "")), str(request.get("reason", "")))
            return {"asked": True}
        raise FieldlinkError(f"there is no command {str(command)!r}")

    async def _resume_writebacks(self) -> None:
        """Go on after the last block of every loop: its number, and what is open about it."""
        try:
            last = await asyncio.to_thread(last_blocks, self._site.historian_url)
            orders = await asyncio.to_thread(last_events, self._site.historian_url, ORDER_EVENTS)
        except StoreError as error:
            self._assembly.journal.event("writeback.past_unknown", "daemon", str(error), bad=True)
        else:
            self._assembly.resume(last)
            recall_orders(orders, self._assembly.orders)

    def _order_for_broker(self, action: Action, loop: str, why: str) -> None:
        self.carry_out(Order(loop, action, "MQTT broker", why))

    def _put(self, record: Record) -> object:
        """Hand a record to the store and, where the site publishes, upward; never waits."""
        if self._publishing is not None:
            self._publishing.put(record)
        return self._historian.put(record)

    def _way_upward(self, site: Site) -> Publishing | None:
        if site.file.mqtt is None:
            return None
        return Publishing(
            site,
            health=lambda: self._assembly.health(store_failing=self._historian.report().failing),
            actions={
                "withdraw": partial(self._order_for_broker, Action.WITHDRAW),
                "estimate_now": partial(self._order_for_broker, Action.ESTIMATE),
            },
            tell=self._assembly.journal.event,
            defect=self._assembly.journal.defect,
        )

    @asynccontextmanager
    async def _upward(self) -> AsyncIterator[list[asyncio.Task[None]]]:
        """Publish while the block runs; yield what must not end by itself."""
        if self._publishing is None:
            yield []
            return
        async with self._publishing.running() as tasks:
            yield tasks

    @asynccontextmanager
    async def _at_work(self) -> AsyncIterator[list[asyncio.Future[None]]]:
        """Start everything; yield what must not end by itself; end it in order."""
        assert self._pool is not None
        self._failed = asyncio.get_running_loop().create_future()
        schedule = self._schedule = Schedule()
        accounts = SlotAccounts(self._historian.put, self._clock)
        warming = spawn(self._pool.warm_up(), "warm-up")
        self._begin_devices(schedule)
        schedule.every(ACCOUNT_EVERY, "slot accounts", self._do(self._account, accounts))
        schedule.every(TIDY_EVERY, "retention", self._do(self._historian.tidy))
        reports = ScheduledReport(self._assembly.journal)
        schedule.every(REPORT_LOOK, "report", partial(self._report, reports))
        self._historian.tidy()
        schedule.start()
        watching = [
            spawn(self._watch_clock(schedule), "clock"),
            spawn(self._watch_site(schedule), "site"),
        ]
        try:
            yield [schedule.failed, self._failed, *watching]
        finally:
            self._stopping = True
            schedule.pause()
            for task in (warming, *watching):
                task.cancel()
            await asyncio.gather(warming, *watching, return_exceptions=True)
            await self._end(self._devices.values(), self._judging)
            for tasks in self._devices.values():
                tasks.account_for_open_slots()
            self._account(accounts)
            schedule.stop()
            self._failed.cancel()

    def _begin_devices(self, schedule: Schedule) -> None:
        runners = self._assembly.runners.values()
        now = self._clock.monotonic()
        for number, runner in enumerate(runners):
            # Devices with the same period are not all asked in the same moment.
            beat = runner.scan_period / runner.speed
            self._begin(runner, now + beat * number / len(runners), schedule)

    def _begin(self, runner: DeviceRunner, begin: float, schedule: Schedule) -> None:
        tasks = DeviceTasks(runner, self._clock, begin)
        tasks.start()
        self._devices[runner.name] = tasks
        for task in tasks.running:
            task.add_done_callback(self._note_end)
        for loop in runner.loops.values():
            seconds = loop.spec.loop.estimate_period / runner.speed
            schedule.every(seconds, _job(loop.name), partial(self._judge, schedule, loop.name))

    def _note_end(self, task: asyncio.Task[None]) -> None:
        """Let an error of a device's task end the daemon: going on without it would be silent."""
        if task.cancelled() or self._failed is None or self._failed.done():
            return
        if (error := task.exception()) is not None:
            self._failed.set_exception(error)

    async def _end(
        self, devices: Iterable[DeviceTasks], others: Iterable[asyncio.Task[None]] = ()
    ) -> None:
        """End devices and wait for what is under way; what takes too long is given up."""
        ending = list(devices)
        for tasks in ending:
            tasks.end()
        deadline = self._clock.monotonic() + STOP_GRACE
        while True:
            # A turn for jobs that have been started and have not run yet.
            await asyncio.sleep(0)
            running = (task for tasks in ending for task in tasks.running)
            left = {task for task in (*running, *others) if not task.done()}
            seconds = deadline - self._clock.monotonic()
            if not left or seconds <= 0.0:
                break
            await asyncio.wait(left, timeout=seconds)
        for task in left:
            self._assembly.journal.event(
                "daemon.unfinished", "daemon", f"{task.get_name()} was given up", bad=True
            )
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    async def _watch_clock(self, schedule: Schedule) -> None:
        while True:
            await asyncio.sleep(CHECK_EVERY)
            self._assembly.journal.summarize()
            step = self._clock_watch.look()
            if step == 0.0:
                continue
            schedule.clock_stepped(step)
            self._assembly.journal.event(
                "clock.stepped",
                "daemon",
                f"the wall clock stepped by {step:+.1f} s; sampling goes on, its samples are now "
                f"marked clock_steps = {self._clock_watch.steps}",
                bad=True,
            )

    async def _watch_site(self, schedule: Schedule) -> None:
        """Take over the site file when that is asked for, or when a file has changed."""
        watch = FileWatch(self._site)
        while True:
            asked = await wait_for(self._wanted, WATCH_EVERY)
            self._wanted.clear()
            changed = self._watch_files and watch.changed()
            if asked or changed:
                watch.accept()
                await self._reload(schedule)
                watch.follow(self._site)

    async def _reload(self, schedule: Schedule) -> None:
        """Read the site anew and take over what has changed; the old one stays if it is wrong."""
        journal = self._assembly.journal
        opened: dict[str, DeviceRunner] = {}
        try:
            site = await asyncio.to_thread(self._reread)
            change = SiteChange.between(self._site, site)
            for name in (*change.changed, *change.added):
                opened[name] = self._assembly.runner(site, name)
                if isinstance(opened[name].link, SteppedLink):
                    raise FieldlinkError(
                        f"device {name!r} runs in virtual time and the daemon by the clock; "
                        "give it a site file of its own"
                    )
                await opened[name].link.open()
        except Exception as error:  # noqa: BLE001  (said, and the site that works stays in force)
            self._refused += 1
            for runner in opened.values():
                await runner.link.close()
            said = str(error) if isinstance(error, FieldlinkError) else repr(error)
            journal.event("site.refused", "daemon", f"the old site stays: {said}", bad=True)
            return
        leaving = {name: self._devices.pop(name) for name in (*change.changed, *change.removed)}
        await self._end(leaving.values())
        for name, tasks in leaving.items():
            await tasks.runner.link.close()
            for loop in tasks.runner.loops:
                schedule.remove(_job(loop))
            del self._assembly.runners[name]
        for name, runner in opened.items():
            self._assembly.runners[name] = runner
            begin = self._clock.monotonic()
            if (before := leaving.get(name)) is not None:
                runner.carry_over(before.runner)
                if runner.speed == before.runner.speed:
                    begin = before.begin
            self._begin(runner, begin, schedule)
        self._site = site
        if self._publishing is not None:
            self._publishing.follow(site)
        self._reloads += 1
        journal.event("site.reloaded", "daemon", str(change))

    def _account(self, accounts: SlotAccounts) -> None:
        accounts.close(self._assembly.counts())

    def _do(self, work: Callable[..., None], *arguments: object) -> Callable[[], Awaitable[None]]:
        async def job() -> None:
            try:
                work(*arguments)
            except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
                self._assembly.journal.defect("daemon", error, "it is tried again at its time")

        return job

    async def _report(self, reports: ScheduledReport) -> None:
        try:
            await reports.write_due(self._site)
        except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
            self._assembly.journal.defect("daemon", error, "it is tried again at its time")

    async def _judge(self, schedule: Schedule, loop: str) -> None:
        async with self._turns:
            runner = self._assembly.runner_of(loop)
            if runner is None or self._stopping:
                return
            asking = runner.loops[loop]
            missing = asking.pipeline.samples_until_estimate
            if missing:
                period = asking.spec.loop.period
                schedule.postpone(_job(loop), missing * period / runner.speed)
                return
            await self._judge_window(loop, asking)

    async def _judge_window(self, loop: str, asking: LoopRunner, *, by_hand: bool = False) -> None:
        task = asyncio.current_task()
        assert task is not None
        assert self._pool is not None
        self._judging.add(task)
        try:
            request = asking.request(by_hand=by_hand)
            estimate = await self._pool.run(request)
            # The site file may have been changed meanwhile: the runner of today decides.
            answered = self._assembly.loop(loop)
            if answered is not None:
                answered.accept(estimate, request)
        except Exception as error:  # noqa: BLE001  (told; the other loops go on)
            self._assembly.journal.defect(loop, error, "this estimate is left out")
        finally:
            self._judging.discard(task)


def _job(loop: str) -> str:
    return f"estimate {loop}"


async def _until(
    stop: asyncio.Event | None, duration: float | None, failures: list[asyncio.Future[None]]
) -> None:
    """Wait for the end; raise when something ended that must not."""
    asked = spawn(_forever(stop), "stop")
    try:
        done, _ = await asyncio.wait(
            [asked, *failures], timeout=duration, return_when=asyncio.FIRST_COMPLETED
        )
        for future in done:
            future.result()
    finally:
        asked.cancel()


async def _forever(stop: asyncio.Event | None) -> None:
    await (stop or asyncio.Event()).wait()
