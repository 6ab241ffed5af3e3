"""One device and its loops: scans go into windows, findings go back into registers.

`poll`, `accept` and `service` are single steps that the live daemon and the lockstep run both call;
when they are called is what differs between the two.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TypeVar

from fieldlink.daemon.estimation.estimating import Estimate
from fieldlink.daemon.reload import same_samples
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.reporting.status import DeviceStatus, LoopStatus
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.sampling.lateness import Lateness
from fieldlink.daemon.windows.pipeline import LoopPipeline
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.writer import WriteBack
from fieldlink.errors import FieldlinkError
from fieldlink.links import (
    CountingLink,
    Link,
    LinkError,
    LinkState,
    RecordingEndedError,
    RegisterAccess,
    Scan,
    SteppedLink,
)
from fieldlink.site import Site
from fieldlink.store import WritebackRecord

__all__ = ["DeviceRunner"]

T = TypeVar("T")

SILENT_AFTER = 20
"""Periods without a new sample after which a loop is said to be silent."""


class DeviceRunner:
    """Runs one device.

    Args:
        site: the site.
        name: the device's name.
        link: its link.
        journal: where everything is said.
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
        read_only: bool = False,
        live: bool = True,
        watch: ClockWatch | None = None,
    ) -> None:
        self.name = name
        self.link = link
        self._stepped = isinstance(link, SteppedLink)
        self.site = site
        self.speed = site.devices[name].speed if live else 1.0
        self.lateness = Lateness()
        self.pipelines = {
            loop: LoopPipeline.of_site(site, loop, self.speed, watch)
            for loop in site.loops_of(name)
        }
        self.ended = False
        self.late = 0
        self._journal = journal
        self._polls = self._requests = self._failures = 0
        self._last_failure = ""
        self._state = LinkState.CLOSED
        self._now = 0.0
        self._unserved: set[str] = set()
        self._sampled_at: dict[str, float] = {}
        self._silent: set[str] = set()
        self._estimates: dict[str, Estimate] = {}
        self._estimate_counts = dict.fromkeys(self.pipelines, 0)
        self._attempts: dict[str, Attempt] = {}
        self._accepted: dict[str, Attempt] = {}
        self._attempt_counts = {loop: Counter[str]() for loop in self.pipelines}
        self._writebacks = {
            loop: self._writeback(site, loop, read_only=read_only, live=live)
            for loop, pipeline in self.pipelines.items()
            if pipeline.loop.writeback.enabled
        }

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
        scan = await self.link.scan()
        if self._stepped:
            # Its plant waits for the scan: nothing can be late, and nothing is missed meanwhile.
            due = None
        self._now = now
        self._polls += 1
        self._requests += scan.requests
        self._watch(scan)
        for pipeline in self.pipelines.values():
            try:
                self._take(pipeline, scan, now, due)
            except Exception as error:  # noqa: BLE001  (told; the other loops go on)
                self._journal.defect(pipeline.name, error, "this sample of the loop is left out")

    def note_defect(self, error: Exception, now: float) -> None:
        """Demote the device for an error in a poll that nobody foresaw; it is polled again.

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
        for pipeline in self.pipelines.values():
            pipeline.pass_by(now)

    def account_for_open_slots(self, now: float) -> None:
        """Count what has not come by plant second ``now`` as missed: nothing more will come."""
        for pipeline in self.pipelines.values():
            pipeline.pass_by(now, grace=0.0)

    def accept(self, estimate: Estimate) -> None:
        """Take over an estimate of one of the loops: say it, and hand it to the write-back."""
        loop = estimate.loop
        self._estimate_counts[loop] += 1
        self._estimates[loop] = estimate
        self._journal.estimate(estimate)
        writeback = self._writebacks.get(loop)
        if writeback is not None and estimate.findings is not None:
            writeback.submit(estimate.findings, estimate.end_utc)

    def resume(self, loop: str, record: WritebackRecord) -> None:
        """Let a loop's write-back find out what became of a block that was begun before."""
        if (writeback := self._writebacks.get(loop)) is not None:
            writeback.resume(record)

    async def service(self, now: float) -> None:
        """Let the loops' write-backs do what is due at plant second ``now``."""
        for loop, writeback in self._writebacks.items():
            try:
                looked = await writeback.service(now)
            except LinkError as error:
                self._note_service(loop, str(error))
            except Exception as error:  # noqa: BLE001  (told; the other loops go on)
                self._journal.defect(loop, error, "the loop's write-back is tried again")
            else:
                if looked:
                    self._note_service(loop, "")

    @property
    def writes(self) -> bool:
        """Whether any loop of the device has its write-back enabled."""
        return bool(self._writebacks)

    def status(self) -> DeviceStatus:
        """Return a snapshot of the device."""
        written = sum(writeback.requests for writeback in self._writebacks.values())
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

    def loop_status(self, loop: str) -> LoopStatus:
        """Return a snapshot of one of its loops."""
        pipeline = self.pipelines[loop]
        return LoopStatus(
            device=self.name,
            counts=pipeline.counts,
            filled=pipeline.filled,
            samples_until_estimate=pipeline.samples_until_estimate,
            latest=pipeline.latest,
            estimates=self._estimate_counts[loop],
            last_estimate=self._estimates.get(loop),
            attempts=self._attempt_counts[loop].total(),
            last_attempt=self._attempts.get(loop),
            last_accepted=self._accepted.get(loop),
            outcomes=dict(self._attempt_counts[loop]),
            idle=self._now - self._sampled_at.get(loop, self._now),
        )

    def inherit(self, old: DeviceRunner) -> None:
        """Take over from a runner what a change of the site file leaves as it is.

        The windows and write-backs of loops whose samples mean the same go on.
        """
        self._now, self._state = old._now, old._state
        for loop in self.pipelines:
            settings = self.site.loops[loop]
            if not same_samples(old.site, self.site, loop):
                continue
            pipeline = old.pipelines[loop]
            pipeline.resettle(settings)
            self.pipelines[loop] = pipeline
            self._estimate_counts[loop] = old._estimate_counts[loop]
            self._attempt_counts[loop] = old._attempt_counts[loop]
            _carry(loop, old._sampled_at, self._sampled_at)
            _carry(loop, old._estimates, self._estimates)
            _carry(loop, old._attempts, self._attempts)
            _carry(loop, old._accepted, self._accepted)
            if loop in old._silent:
                self._silent.add(loop)
            before, after = old._writebacks.get(loop), self._writebacks.get(loop)
            if before is not None and after is not None:
                after.inherit(before)

    def _take(
        self, pipeline: LoopPipeline, scan: Scan, now: float, due: float | None = None
    ) -> None:
        record = pipeline.take(scan, now, due)
        if record is not None:
            self._journal.sample(record)
            if record.late_ms is not None:
                self.lateness.note(0.001 * record.late_ms)
        self._watch_loop(pipeline, now, sampled=record is not None)

    def _watch(self, scan: Scan) -> None:
        self._failures += len(scan.failures)
        if scan.failures:
            self._last_failure = str(scan.failures[0])
        if not self.ended and any(isinstance(f, RecordingEndedError) for f in scan.failures):
            self.ended = True
        before, self._state = self._state, self.link.state
        if self._state is not before:
            message = self._last_failure if scan.failures else self._state.advice
            kind = f"device.{self._state.name.lower()}"
            self._journal.event(
                kind, self.name, message, bad=self._state is not LinkState.GOOD and not self.ended
            )

    def _watch_loop(self, pipeline: LoopPipeline, now: float, *, sampled: bool) -> None:
        """Say when a loop has no new samples although its device answers, and when it has again."""
        loop = pipeline.name
        since = self._sampled_at.setdefault(loop, now)
        if sampled:
            self._sampled_at[loop] = now
            if loop in self._silent:
                self._silent.discard(loop)
                self._journal.event("loop.sampled", loop, f"new samples after {now - since:.0f} s")
        elif (
            now - since > SILENT_AFTER * pipeline.loop.period
            and loop not in self._silent
            and self._state in (LinkState.GOOD, LinkState.DEGRADED)
        ):
            self._silent.add(loop)
            self._journal.event(
                "loop.silent",
                loop,
                f"no new sample for {now - since:.0f} s: OP or PV cannot be read, or the cycle "
                "counter stands still; look at the tags and whether the controller runs",
                bad=True,
            )

    def _note_service(self, loop: str, error: str) -> None:
        """Say when a loop's exchange area stops answering, and when it answers again."""
        if error and loop not in self._unserved:
            self._unserved.add(loop)
            self._journal.event("writeback.unreachable", loop, error, bad=True)
        elif not error and loop in self._unserved:
            self._unserved.discard(loop)
            self._journal.event("writeback.reachable", loop, "the exchange area answers again")

    def _note_attempt(self, loop: str, attempt: Attempt) -> None:
        self._attempts[loop] = attempt
        self._attempt_counts[loop][attempt.outcome.code] += 1
        if attempt.outcome is WritebackOutcome.ACCEPTED:
            self._accepted[loop] = attempt
            self.pipelines[loop].restart_window()
        self._journal.attempt(loop, attempt)

    def _writeback(self, site: Site, loop: str, *, read_only: bool, live: bool) -> WriteBack:
        settings = site.loops[loop].writeback
        layout = settings.exchange
        device = site.devices[self.name]
        if layout is None or not isinstance(self.link, RegisterAccess):
            raise FieldlinkError(
                f"loops.{loop}.writeback: device {self.name!r} has no registers to write to; "
                'set enabled = false, or use link = "modbus-tcp"'
            )
        period = site.loops[loop].period
        pause: Callable[[], Awaitable[None]] = partial(
            asyncio.sleep, period / self.speed if live else 0.0
        )
        return WriteBack(
            settings,
            Exchange(
                self.link,
                layout,
                device.word_order,
                max_gap=device.max_gap,
                readable=device.ranges,
            ),
            period=period,
            read_only=read_only,
            pause=pause,
            report=partial(self._note_attempt, loop),
            keep=partial(self._journal.begin, loop),
        )


def _carry(loop: str, old: dict[str, T], new: dict[str, T]) -> None:
    if loop in old:
        new[loop] = old[loop]
