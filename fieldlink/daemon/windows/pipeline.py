"""One loop from scans to windows: every sample is placed, counted and handed on.

Nothing here waits or knows the time of day, so the live daemon and the lockstep run share it.
"""

from __future__ import annotations

import math

from fieldlink.daemon.estimation.estimating import EstimateRequest
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.sampling.counter_rate import CounterRate
from fieldlink.daemon.sampling.slot_placing import BeatPlacer, CounterPlacer, Place, Placed, Placer
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.windows.window import LoopSample, Window, WindowData
from fieldlink.links import Quality, Reading, Scan
from fieldlink.links.usual_delay import UsualDelay
from fieldlink.registers import Tag
from fieldlink.site import Loop, Site
from fieldlink.store import SampleRecord

__all__ = ["LoopPipeline"]

LATE_SHARE = 0.1
"""Share of a period by which a reply may come later than due and still be in time."""

LATEST_START = 0.25
"""Share of a period by which a poll may begin late, or a value be read later than usual, where
samples are placed by the clock: what is read then is three times nearer to its own slot than to the
next. Later it is marked bad. What is read once a session has been opened is never usual."""

GRACE = 3.0
"""Periods without a sample after which its open slots count as missed: a controller whose cycles
are a little longer than the period of the site file misses none of its own."""

# By code: hashing a member of an enumeration is a call, and both are asked for every sample.
_NOT_THERE = frozenset(
    quality.code
    for quality in (Quality.NOT_READ, Quality.NOT_DUE, Quality.QUARANTINED, Quality.UNKNOWN_TAG)
)

_MISPLACED = frozenset(
    quality.code for quality in (Quality.NO_COUNT, Quality.RESTARTED, Quality.LATE)
)


class LoopPipeline:
    """The samples of one loop.

    Args:
        name: the loop's name.
        loop: its settings.
        counter: the tag of its cycle counter, None when it has none.
        speed: plant seconds per second of the wall clock.
        watch: tells to which stretch of a stepping clock a stamp belongs; None where none steps.
        paced: whether the controller keeps the clock's time, as every real one does.
    """

    def __init__(
        self,
        name: str,
        loop: Loop,
        counter: Tag | None,
        speed: float = 1.0,
        watch: ClockWatch | None = None,
        *,
        paced: bool = True,
    ) -> None:
        self.name = name
        self.loop = loop
        self._speed = speed
        self._watch = watch
        self._late_after = LATE_SHARE * loop.period / speed
        self._placer = _placer(loop, counter)
        self._rate = CounterRate(loop.period) if paced and loop.scan is not None else None
        self._window = Window(
            loop.window, has_sp=loop.sp is not None, has_auto=loop.mode is not None
        )
        self._every = max(1, round(loop.estimate_period / loop.period))
        self._estimated_at: int | None = None
        self._latest_start = LATEST_START * loop.period / speed
        self._usual = UsualDelay()
        self._sampled_at: float | None = None
        self._open = 0
        self._read = self._bad = self._missed = 0
        self._late = self._duplicates = self._restarts = 0
        self.latest: SampleRecord | None = None

    @classmethod
    def of_site(
        cls, site: Site, name: str, speed: float = 1.0, watch: ClockWatch | None = None
    ) -> LoopPipeline:
        """Build the pipeline of a loop of the site file."""
        loop = site.loops[name]
        counter = None if loop.scan is None else site.maps.get(loop.device, {}).get(loop.scan)
        return cls(name, loop, counter, speed, watch)

    def resettle(self, loop: Loop, *, again: bool = False) -> None:
        """Go on with changed settings of estimation or write-back, and with the window.

        Args:
            loop: the new settings.
            again: ask for the last estimate once more, because its result will be dropped.
        """
        self.loop = loop
        if again:
            self._estimated_at = None
        self._every = max(1, round(loop.estimate_period / loop.period))

    @property
    def counts(self) -> LoopCounts:
        """The counts of the loop's samples up to now."""
        read, bad, missed = self._read, self._bad, self._missed
        return LoopCounts(
            read + bad + missed, read, bad, missed, self._late, self._duplicates, self._restarts
        )

    @property
    def counted_every(self) -> float | None:
        """Plant seconds between two counts of the cycle counter, where that is not the period."""
        return None if self._rate is None else self._rate.counted_every

    @property
    def filled(self) -> float:
        """How much of the window is there, 0 to 1."""
        return self._window.span / self._window.size

    @property
    def samples_until_estimate(self) -> int:
        """Samples to come before the next estimate is due; 0 when it is.

        The first is due when the window is full, the next ``estimate_every`` later.
        """
        missing = self._window.size - self._window.span
        if self._estimated_at is not None:
            missing = max(missing, self._estimated_at + self._every - self._window.last_slot)
        return max(0, missing)

    def take(self, scan: Scan, now: float, due: float | None = None) -> SampleRecord | None:
        """Put the loop's part of a scan into the window.

        Args:
            scan: all tags of the loop's device.
            now: plant seconds at which the scan was due.
            due: the same moment in seconds of the link's clock; None where nothing can be late.

        Returns:
            What to store; None when the scan has nothing new of this loop.
        """
        loop = self.loop
        # Each is looked up once: this runs for every sample of every loop.
        op, pv = scan[loop.op], scan[loop.pv]
        counter, moment = None, now
        if loop.scan is not None:
            counter = scan[loop.scan]
            if due is not None:
                # A count is of the moment it was read, which a daemon that stood still may be late
                # for; a sample without one belongs to the beat it was due in.
                moment += self._speed * max(0.0, counter.monotonic - due)
        placed = self._place(op, pv, counter, moment)
        if placed is None:
            if due is not None:
                self.pass_by(now)
            return None
        belated = False
        if due is not None and counter is None:
            read = max(op.monotonic, pv.monotonic) - due
            read += placed.behind / self._speed
            later = read if scan.connected else self._usual.exceed(read)
            belated = max(later, scan.monotonic - due) > self._latest_start
        sample = self._sample(scan, op, pv, self._worst(op, pv, placed.place, belated))
        # What the clock has counted as missed already is not counted again.
        self._missed += max(0, self._window.put(placed.slot, sample) - self._open)
        self._sampled_at, self._open = moment, 0
        if sample.quality == 0:
            self._read += 1
        else:
            self._bad += 1
        if placed.place is Place.RESTARTED:
            self._restarts += 1
        late = None
        if due is not None:
            late = max(0.0, pv.monotonic - due)
            if late > self._late_after:
                self._late += 1
        steps = 0 if self._watch is None else self._watch.stretch_of(pv.utc - pv.monotonic)
        self.latest = self._record(placed.slot, sample, late, steps)
        return self.latest

    def pass_by(self, now: float, grace: float = GRACE) -> None:
        """Count slots that stay open as missed, although no sample has come that ends the gap.

        Args:
            now: plant seconds.
            grace: periods that may pass without a sample; 0 when none will come any more.
        """
        if self._sampled_at is None:
            self._sampled_at = now - self.loop.period
        periods = (now - self._sampled_at) / self.loop.period
        # A slot counts when it is overdue: by half a period at the end, before that by a whole one.
        overdue = math.floor(periods - (1.0 if grace else 0.5) + 1e-3)
        if periods > grace and overdue > self._open:
            self._missed += overdue - self._open
            self._open = overdue

    def restart_window(self) -> None:
        """Begin a new window: the loop's controller is another one from here on.

        A window is one experiment; one half of which was compensated fits neither model.
        """
        self._window.restart()

    def request(
        self,
        epoch: int = 0,
        now: float = 0.0,
        *,
        compensated: bool = False,
        by_hand: bool = False,
    ) -> EstimateRequest:
        """Return the window as a request to the estimator; the next one is due later.

        Args:
            epoch: of the loop's runner.
            now: the plant second.
            compensated: whether a block may have been in force during the window.
            by_hand: whether an operator asks; this does not change when the next window is due.
        """
        if not by_hand:
            self._estimated_at = self._window.last_slot
        settings = self.loop.estimator
        return EstimateRequest(
            self.name,
            self._window.data(),
            self.loop.period,
            settings.criterion,
            settings.confidence,
            epoch,
            now,
            compensated,
            by_hand,
        )

    def full_window(self) -> WindowData | None:
        """Return a copy of the window for a diagnosis; None before it is full."""
        return self._window.data() if self._window.is_full else None

    def _place(
        self, op: Reading, pv: Reading, counter: Reading | None, now: float
    ) -> Placed | None:
        """Return the slot of what a scan has of the loop; None when it has nothing new."""
        if self._sampled_at is None:
            self._sampled_at = now - self.loop.period
        if op.quality.code in _NOT_THERE or pv.quality.code in _NOT_THERE:
            return None
        if counter is not None and not counter.good:
            return None
        placed = self._placer.place(now, 0.0 if counter is None else counter.value)
        if placed.place is Place.DUPLICATE:
            self._duplicates += 1
            return None
        if self._rate is not None:
            if placed.place is Place.NEXT:
                self._rate.note(now, placed.slot)
            else:
                self._rate.start_again()
        return placed

    def _worst(self, op: Reading, pv: Reading, place: Place, belated: bool) -> int:
        """Return the code of the sample's quality.

        A moment that is not its slot's is as bad as a value.

        Args:
            op, pv: the readings.
            place: how the slot was found.
            belated: whether they are of another moment; never where a count places the sample.
        """
        if place is Place.NEXT:
            if belated:
                return Quality.LATE.code
            return max(op.quality.code, pv.quality.code)
        if place is Place.NO_COUNT:
            return Quality.NO_COUNT.code
        # A PLC that starts again may show zeros before it has measured anything.
        return Quality.RESTARTED.code

    def _sample(self, scan: Scan, op: Reading, pv: Reading, quality: int) -> LoopSample:
        loop, nan = self.loop, math.nan
        sp = nan if loop.sp is None else scan[loop.sp].value
        auto = nan
        if loop.mode is not None:
            mode = scan[loop.mode]
            auto = float(mode.value in loop.auto_values) if mode.good else nan
        if quality in _MISPLACED:
            return LoopSample(nan, nan, sp, auto, pv.utc, quality)
        return LoopSample(op.value, pv.value, sp, auto, pv.utc, quality)

    def _record(
        self, slot: int, sample: LoopSample, late: float | None, clock_steps: int
    ) -> SampleRecord:
        return SampleRecord(
            loop=self.name,
            utc_ms=round(sample.utc * 1000.0),
            slot=slot,
            op=sample.op,
            pv=sample.pv,
            sp=None if self.loop.sp is None else sample.sp,
            auto=None if math.isnan(sample.auto) else bool(sample.auto),
            quality=sample.quality,
            late_ms=None if late is None else round(1000.0 * late),
            clock_steps=clock_steps,
        )


def _placer(loop: Loop, counter: Tag | None) -> Placer:
    if loop.scan is None:
        return BeatPlacer(loop.period)
    modulus = math.inf
    if counter is not None:
        modulus = abs(counter.scale) * counter.data_type.modulus
    return CounterPlacer(loop.period, modulus)
