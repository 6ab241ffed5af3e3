"""One device and its loops: scans go into windows, findings go back into registers.

`poll` and `service` are single steps that the live daemon and the lockstep run both call;
when they are called is what differs between the two.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress

from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.daemon.operators.orders import keep_orders
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.reporting.status import DeviceStatus
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.sampling.lateness import Lateness
from fieldlink.daemon.writeback.area_looks import AreaLooks
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.links import (
    CountingLink,
    Link,
    LinkState,
    PlantFailedError,
    RecordingEndedError,
    Scan,
    SteppedLink,
)
from fieldlink.registers import HEARTBEAT_EVERY
from fieldlink.site import Site

__all__ = ["DeviceRunner"]


class DeviceRunner:
    """Runs one device.

    Args:
        site: the site.
        name: the device's name.
        link: its link.
        journal: takes every event and error.
        numbers: the sequence numbers of every loop's blocks, by the loop's name.
        orders: what operators have ordered for every loop's write-back, by the loop's name.
        identity: of this installation; None where it has none.
        read_only: never write to the device.
        live: whether time goes on by itself while something is awaited.
        watch: knows how the wall clock has stepped; None where none does.
    """

    def __init__(
        self,
        site: Site,
        name: str,
        link: Link,
        journal: Journal,
        *,
        numbers: dict[str, SequenceNumbers],
        orders: dict[str, StandingOrders],
        identity: int | None = None,
        read_only: bool = False,
        live: bool = True,
        watch: ClockWatch | None = None,
    ) -> None:
        self.name = name
        self.link = link
        self._stepped = isinstance(link, SteppedLink)
        self.site = site
        self.speed = site.devices[name].speed if live else 1.0
        self._live = live
        self._scanned = asyncio.Event()
        self._areas = AreaLooks(site.devices[name].timeout * self.speed)
        self.lateness = Lateness()
        self.loops = {
            loop: LoopRunner(
                LoopSpec.of_site(site, loop, live=live),
                link,
                journal,
                numbers=numbers.setdefault(loop, SequenceNumbers()),
                orders=orders.setdefault(loop, StandingOrders()),
                identity=identity,
                read_only=read_only,
                live=live,
                watch=watch,
            )
            for loop in site.loops_of(name)
        }
        self.ended = False
        self.late = 0
        self._journal = journal
        self._polls = self._requests = self._failures = 0
        self._last_failure = ""
        self._state = LinkState.CLOSED
        self._now = 0.0

    @property
    def scan_period(self) -> float:
        """Plant seconds from one scan to the next; the link has to be open.

        A link whose plant moves only when it is scanned decides that itself.
        """
        if isinstance(self.link, SteppedLink):
            return self.link.scan_period
        return self.site.poll_period(self.name)

    async def poll(self, now: float, due: float | None = None) -> None:
        """Scan once.

        Args:
            now: the plant second at which that was due.
            due: the same moment in seconds of the link's clock; None where nothing can be late.
        """
        try:
            scan = await self.link.scan()
        finally:
            self._scanned.set()
            self._scanned = asyncio.Event()
        if self._stepped:
            # Its plant waits for the scan: nothing can be late, and nothing is missed meanwhile.
            due = None
        self._now = now
        self._polls += 1
        self._requests += scan.requests
        self._watch(scan)
        for loop in self.loops.values():
            try:
                record = loop.take(scan, now, due, answers=self._answers)
            except Exception as error:  # noqa: BLE001  (told; the other loops go on)
                self._journal.defect(loop.name, error, "this sample of the loop is left out")
            else:
                if record is not None and record.late_ms is not None:
                    self.lateness.note(0.001 * record.late_ms)

    def note_defect(self, error: Exception, now: float) -> None:
        """Demote the device for an unforeseen error in a poll; it is polled again.

        Args:
            error: what was raised.
            now: the plant second at which the poll was due.
        """
        self._now = now
        self._failures += 1
        self._state = LinkState.DEMOTED
        self._last_failure = self._journal.defect(
            self.name, error, "the device is demoted and polled again, the others go on"
        )
        for loop in self.loops.values():
            loop.pipeline.pass_by(now)

    def account_for_open_slots(self, now: float) -> None:
        """Count what has not come by plant second ``now`` as missed: nothing more will come."""
        for loop in self.loops.values():
            loop.pipeline.pass_by(now, grace=0.0)

    async def service(self, now: float) -> None:
        """Let the loops' write-backs do what is due at plant second ``now``."""
        for loop in self.loops.values():
            if not self._areas.is_silent(loop.name):
                await self._look(loop, now)
        while (silent := self._areas.next_silent(now)) is not None:
            await self._wait_for_a_scan()
            if not await self._look(self.loops[silent], now):
                break

    @property
    def _answers(self) -> bool:
        """Whether the device answers its polls."""
        return self._state in (LinkState.GOOD, LinkState.DEGRADED)

    async def _look(self, loop: LoopRunner, now: float) -> bool:
        """Let one write-back do what is due; return whether its area was looked at and answers."""
        looked = await loop.service(now, device_answers=self._answers)
        if looked:
            self._areas.note(loop.name, loop.last_look, now, answers=self._answers)
        return looked and not self._areas.is_silent(loop.name)

    async def _wait_for_a_scan(self) -> None:
        """Wait for the end of a scan, not for long: until the next one there is room for a look."""
        if not self._live:
            return
        with suppress(TimeoutError):
            async with asyncio.timeout(0.5 * HEARTBEAT_EVERY / self.speed):
                await self._scanned.wait()

    @property
    def writes(self) -> bool:
        """Whether any loop of the device has its write-back enabled."""
        return any(loop.writer is not None for loop in self.loops.values())

    def status(self) -> DeviceStatus:
        """Return a snapshot of the device."""
        written = sum(
            loop.writer.requests for loop in self.loops.values() if loop.writer is not None
        )
        counting = self.link if isinstance(self.link, CountingLink) else None
        return DeviceStatus(
            state=self._state,
            polls=self._polls,
            late=self.late,
            requests=self._requests + written,
            failures=self._failures,
            last_failure=self._last_failure,
            plant_time=self._now,
            lateness=self.lateness.report(),
            connects=0 if counting is None else counting.connects,
            late_replies=0 if counting is None else counting.late_replies,
            quarantined=() if counting is None else counting.quarantined,
        )

    def carry_over(self, old: DeviceRunner) -> None:
        """Take over from a runner what a change of the site file leaves as it is."""
        self._now, self._state = old._now, old._state
        gone = [loop for name, loop in old.loops.items() if name not in self.loops]
        for name, loop in self.loops.items():
            if name in old.loops:
                loop.carry_over(old.loops[name])
                continue
            same = (one for one in gone if loop.spec.has_samples_of(one.spec))
            if (former := next(same, None)) is not None:
                # The same valve under another name.
                gone.remove(former)
                keep_orders(loop, former, self._journal)
                loop.carry_over(former)

    def _watch(self, scan: Scan) -> None:
        self._failures += len(scan.failures)
        if scan.failures:
            self._last_failure = str(scan.failures[0])
        if not self.ended and any(isinstance(f, RecordingEndedError) for f in scan.failures):
            self.ended = True
        for failure in scan.failures:
            if isinstance(failure, PlantFailedError):
                self._journal.event("plant.failed", self.name, str(failure), bad=True)
        before, self._state = self._state, self.link.state
        if self._state is not before:
            is_good = self._state is LinkState.GOOD
            message = self._last_failure if scan.failures and not is_good else self._state.advice
            kind = f"device.{self._state.name.lower()}"
            self._journal.event(kind, self.name, message, bad=not is_good and not self.ended)
