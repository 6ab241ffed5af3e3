"""One loop and all of its state: window, estimates, write-back and their outcomes.

A `LoopRunner` is built from one frozen specification, endpoint included, and has an epoch. What
comes back late (an estimate) carries the epoch it was asked in and is dropped when it is another's.
A changed site file makes a new runner, which takes over only what `carry_over` names.
"""

from __future__ import annotations

import asyncio
import itertools
from collections import Counter
from dataclasses import replace
from functools import partial

from fieldlink.daemon.estimation.estimating import Estimate, EstimateRequest
from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.reporting.status import LoopStatus
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.sampling.silence import SilenceWatch, fault_of
from fieldlink.daemon.windows.pipeline import LoopPipeline
from fieldlink.daemon.writeback.asked_withdrawal import WITHDRAWAL_ASKED
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.daemon.writeback.writer import BlockWriter
from fieldlink.errors import FieldlinkError
from fieldlink.links import Link, LinkError, LinkPausedError, RegisterAccess, Scan
from fieldlink.registers import HEARTBEAT_EVERY
from fieldlink.store import SampleRecord, WritebackRecord

__all__ = ["LoopRunner", "WritebackOffError"]

AGE_IN_ESTIMATES = 4.0
"""Estimate periods for which a finding may wait: two windows in which others would confirm it."""

_epochs = itertools.count(1)


class WritebackOffError(FieldlinkError):
    """The site file does not let a loop be written."""

    def __init__(self, loop: str) -> None:
        """Say so of a loop."""
        super().__init__(
            f"loops.{loop}.writeback is not enabled, so nothing may be written; clear the PLC's "
            "enable bit to end the use of a block"
        )


class LoopRunner:
    """Runs one loop.

    Args:
        spec: what the loop is.
        link: its device's link.
        journal: takes every event and error.
        numbers: the sequence numbers of the loop's blocks.
        orders: what operators have ordered for the loop's write-back.
        identity: of this installation; None where it has none.
        read_only: never write to the device.
        live: whether time goes on by itself while something is awaited.
        watch: knows how the wall clock has stepped; None where none does.

    Attributes:
        epoch: no other runner has it.
        dropped: estimates that came for another epoch.
        last_look: why the last look at the exchange area failed; None when it did not.
    """

    def __init__(
        self,
        spec: LoopSpec,
        link: Link,
        journal: Journal,
        *,
        numbers: SequenceNumbers,
        orders: StandingOrders | None = None,
        identity: int | None = None,
        read_only: bool = False,
        live: bool = True,
        watch: ClockWatch | None = None,
    ) -> None:
        self.spec = spec
        self.orders = orders or StandingOrders()
        self.numbers = numbers
        self.epoch = next(_epochs)
        self.dropped = 0
        self._former_name = ""
        self.last_look: LinkError | None = None
        counter = None if spec.loop.scan is None else spec.tags.get(spec.loop.scan)
        # A simulated plant that runs faster than the clock may fall behind it.
        paced = spec.speed == 1.0 and spec.device.pace == "clock"
        self.pipeline = LoopPipeline(spec.name, spec.loop, counter, spec.speed, watch, paced=paced)
        self._journal = journal
        self._now = 0.0
        self._fault = self._mistimed = ""
        self._silence = SilenceWatch(spec.name, spec.loop.period, journal)
        self._asked = 0
        self._estimate: Estimate | None = None
        self._estimates = 0
        self._attempt: Attempt | None = None
        self._accepted: Attempt | None = None
        self._outcomes = Counter[str]()
        self._unserved = False
        self._compensates: bool | None = None
        self.writer = (
            self._writer(link, identity, read_only=read_only, live=live)
            if spec.loop.writeback.enabled
            else None
        )

    @property
    def name(self) -> str:
        """The loop's name."""
        return self.spec.name

    @property
    def newest_estimate(self) -> Estimate | None:
        """The newest outcome of the estimator; None before the first."""
        return self._estimate

    def take(
        self, scan: Scan, now: float, due: float | None, *, answers: bool
    ) -> SampleRecord | None:
        """Take the loop's part of a scan; return the sample, None when there is none.

        Args:
            scan: all tags of the device.
            now: plant seconds at which it was due.
            due: the same in seconds of the link's clock; None where nothing can be late.
            answers: whether the device answers, so that a loop without samples is silent itself.
        """
        self._now = now
        record = self.pipeline.take(scan, now, due)
        if record is not None:
            self._journal.sample(record)
        fault = fault_of(record, self.spec.loop, scan)
        if record is not None:
            self._fault = fault
            self._watch_the_period()
        self._silence.look(now, sampled=record is not None, answers=answers, fault=fault)
        return record

    def request(self, *, by_hand: bool = False) -> EstimateRequest:
        """Return the window as a request of this epoch; see `EstimateRequest.by_hand`."""
        self._asked += 1
        compensated = self.writer is not None and self.writer.may_compensate
        return self.pipeline.request(
            self.epoch, self._now, compensated=compensated, by_hand=by_hand
        )

    def accept(self, estimate: Estimate, request: EstimateRequest) -> bool:
        """Take over an estimate; False when it was asked in another epoch, and dropped."""
        if request.epoch != self.epoch:
            self.dropped += 1
            self._journal.event(
                "estimate.dropped",
                self.name,
                "the site file has changed since it was asked for; the next window decides",
            )
            return False
        self._asked = max(0, self._asked - 1)
        self._estimates += 1
        self._estimate = estimate
        self._journal.estimate(estimate)
        # Windows asked for by hand overlap each other: their agreement proves nothing.
        if self.writer is not None and estimate.findings is not None and not request.by_hand:
            self.writer.submit(
                estimate.findings,
                estimate.end_utc,
                since=request.asked_at,
                compensated=request.compensated,
            )
        return True

    def resume(self, record: WritebackRecord) -> None:
        """Go on after the last block that a process before this one has recorded."""
        if self.writer is not None:
            self.writer.resume(record)

    def withdraw(self, reason: str, utc: float) -> None:
        """Withdraw the loop's block; see `BlockWriter.withdraw`.

        Raises:
            WritebackOffError: the site file does not let this loop be written.
        """
        if self.writer is None:
            raise WritebackOffError(self.name)
        after = self.numbers.last
        self.writer.withdraw(reason, utc)
        asked = self._journal.event_record(WITHDRAWAL_ASKED, self.name, reason)
        self._journal.order(replace(asked, detail={"after": after}))

    def withdraw_again(self, reason: str, utc: float) -> None:
        """Go on with a withdrawal that the PLC had not got when a process before this one ended."""
        if self.writer is not None:
            self.writer.withdraw(reason, utc)

    async def service(self, now: float, *, device_answers: bool = True) -> bool:
        """Let the write-back do what is due; return whether it looked.

        Args:
            now: the plant second.
            device_answers: whether the device answers its polls; that it does not is told of the
                device, and not of each of its loops as well.
        """
        if self.writer is None:
            return False
        looked, self.last_look = True, None
        try:
            looked = await self.writer.service(now)
        except LinkError as error:
            self.last_look = error
            if device_answers and not isinstance(error, LinkPausedError):
                self._note_service(str(error))
        except Exception as error:  # noqa: BLE001  (told; the other loops go on)
            self._journal.defect(self.name, error, "the loop's write-back is tried again")
        else:
            if looked:
                self._note_service("")
        self._follow_compensation(self.writer.compensates)
        return looked

    def status(self, device: str) -> LoopStatus:
        """Return a snapshot."""
        writer = self.writer
        return LoopStatus(
            device=device,
            counts=self.pipeline.counts,
            filled=self.pipeline.filled,
            samples_until_estimate=self.pipeline.samples_until_estimate,
            latest=self.pipeline.latest,
            fault=self._fault or self._mistimed,
            estimates=self._estimates,
            last_estimate=self._estimate,
            attempts=self._outcomes.total(),
            last_attempt=self._attempt,
            last_accepted=self._accepted,
            outcomes=dict(self._outcomes),
            idle=self._silence.idle(self._now),
            dropped_estimates=self.dropped,
            waiting=None if writer is None else writer.waiting,
            refusal="" if writer is None else writer.refusal,
            unused="" if writer is None else writer.unused,
            block=None if writer is None else writer.block,
            in_use=None if writer is None else writer.compensates,
            may_write=writer is not None,
            hold=self.orders.hold,
            off=self.orders.off,
        )

    def carry_over(self, old: LoopRunner) -> None:
        """Take over what still holds from the loop's former runner; drop everything else.

        The window with its counts, where the samples mean the same; the write-back, where its
        registers and the valve behind them are the same. An estimate that was asked for is asked
        for again.
        """
        if not self.spec.has_samples_of(old.spec):
            return
        self._former_name = old.take_former_name() or old.name
        self._now = old._now
        self.pipeline = old.pipeline
        self.pipeline.name = self.name
        self.pipeline.resettle(self.spec.loop, again=old._asked > 0)
        self._fault, self._mistimed = old._fault, old._mistimed
        if self.writer is not None:
            self.writer.mistrust_time(self._mistimed)
        self._silence.carry_over(old._silence)
        self._estimate, self._estimates = old._estimate, old._estimates
        self._attempt, self._accepted = old._attempt, old._accepted
        self._outcomes = old._outcomes
        self.dropped = old.dropped
        if self.writer is None or old.writer is None:
            return
        if self.spec.has_block_of(old.spec):
            self._compensates = old._compensates
            self.writer.carry_over(old.writer)

    def take_former_name(self) -> str:
        """Return the name that the site file gave this loop before, once; empty without one."""
        former, self._former_name = self._former_name, ""
        return former if former != self.name else ""

    def _follow_compensation(self, compensates: bool | None) -> None:
        """Begin a new window when a block comes into force or goes out of it.

        A window is one experiment; one half of which was compensated fits neither model.
        """
        before, self._compensates = self._compensates, compensates
        if before is compensates or (before is None and not compensates):
            return
        self.pipeline.restart_window()

    def _watch_the_period(self) -> None:
        """Tell when the cycle counter shows another period than the site file, and when not."""
        every, known = self.pipeline.counted_every, self._mistimed
        if (every is not None) is bool(known):
            return
        loop, self._mistimed = self.spec.loop, ""
        if every is None:
            self._journal.event(
                "loop.right_period", self.name, f"{loop.scan} counts every {loop.period:g} s again"
            )
        else:
            self._mistimed = (
                f"the cycle counter {loop.scan} counts every {every:.3g} s, not every "
                f"{loop.period:g} s as period says"
            )
            advice = WritebackOutcome.WRONG_PERIOD.advice
            words = f"{self._mistimed}; {advice}"
            self._journal.event("loop.wrong_period", self.name, words, bad=True)
        if self.writer is not None:
            self.writer.mistrust_time(self._mistimed)

    def _note_service(self, error: str) -> None:
        """Tell when the exchange area stops answering, and when it answers again."""
        if error and not self._unserved:
            self._unserved = True
            self._journal.event("writeback.unreachable", self.name, error, bad=True)
        elif not error and self._unserved:
            self._unserved = False
            self._journal.event("writeback.reachable", self.name, "the exchange area answers again")

    def _note_attempt(self, attempt: Attempt) -> None:
        self._attempt = attempt
        self._outcomes[attempt.outcome.code] += 1
        if attempt.outcome is WritebackOutcome.ACCEPTED:
            self._accepted = attempt
        self._journal.attempt(self.name, attempt)

    def _tell(self, kind: str, message: str) -> None:
        self._journal.event(kind, self.name, message, bad=True)

    def _writer(
        self,
        link: Link,
        identity: int | None,
        *,
        read_only: bool,
        live: bool,
    ) -> BlockWriter:
        spec = self.spec
        settings = spec.loop.writeback
        layout = settings.exchange
        if layout is None or not isinstance(link, RegisterAccess):
            raise FieldlinkError(
                f"loops.{self.name}.writeback: device {spec.loop.device!r} has no registers to "
                'write to; set enabled = false, or use link = "modbus-tcp"'
            )
        # One scan of the PLC is at most a period of the loop, and no heartbeat may wait for it.
        scan = min(spec.loop.period, HEARTBEAT_EVERY) / spec.speed
        return BlockWriter(
            settings,
            Exchange(
                link,
                layout,
                spec.device.word_order,
                device=spec.loop.device,
                max_gap=spec.device.max_gap,
                readable=spec.device.ranges,
            ),
            period=spec.loop.period,
            read_only=read_only,
            pause=partial(asyncio.sleep, scan if live else 0.0),
            report=self._note_attempt,
            keep=partial(self._journal.begin, self.name),
            tell=self._tell,
            numbers=self.numbers,
            identity=identity,
            orders=self.orders,
            max_age=AGE_IN_ESTIMATES * spec.loop.estimate_period,
        )
