"""What happens is reported once and kept: a log line for people, a record for the store.

Events are for changes, not for states: a device that is silent for a day is two lines, not a line a
second. What changes all the time is summed up once a minute (`event_limit`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future

import structlog

from fieldlink.daemon.estimation.estimating import Estimate, EstimateOutcome
from fieldlink.daemon.reporting.defects import describe_defect
from fieldlink.daemon.reporting.event_limit import EventLimit
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.links import Clock
from fieldlink.store import EventRecord, Record, SampleRecord

__all__ = ["Journal"]

_log = structlog.get_logger(__name__)

_EXPECTED = frozenset(
    {
        WritebackOutcome.COMMITTED,
        WritebackOutcome.ACCEPTED,
        WritebackOutcome.UNCHANGED,
        WritebackOutcome.TOO_FEW_WINDOWS,
        WritebackOutcome.TOO_SOON,
        WritebackOutcome.READ_ONLY,
        WritebackOutcome.SUPERSEDED,
        WritebackOutcome.NOT_ENABLED,
        WritebackOutcome.INTERRUPTED,
        WritebackOutcome.KEPT_VALID,
        WritebackOutcome.ON_HOLD,
        WritebackOutcome.SWITCHED_OFF,
    }
)


def _rounded(value: float, digits: int = 3) -> float | None:
    """Return a figure for a log line; None for one that the estimator does not know.

    A log of JSON has no NaN.
    """
    return round(value, digits) if math.isfinite(value) else None


class Journal:
    """Logs and stores.

    Args:
        put: takes a record for the store; must not block a live daemon.
        clock: gives the time of day.
        keep: takes a record and promises that it will be stored; None where nothing has to outlive
            the process, as in a simulation.

    Attributes:
        defects: errors met that the program does not foresee.
    """

    def __init__(
        self,
        put: Callable[[Record], object],
        clock: Clock,
        keep: Callable[[Record], Future[bool]] | None = None,
    ) -> None:
        self._put = put
        self._clock = clock
        self._keep = keep
        self._limit = EventLimit(clock)
        self._defects: dict[str, str] = {}
        self.defects = 0

    def sample(self, record: SampleRecord) -> None:
        """Store a sample."""
        self._put(record)

    def estimate(self, estimate: Estimate) -> None:
        """Log and store an estimate."""
        self._put(estimate.record(self._clock.utc()))
        found = estimate.findings
        if found is None:
            level = _log.info if estimate.outcome is EstimateOutcome.REFUSED else _log.error
            level(
                "estimate.failed",
                loop=estimate.loop,
                outcome=estimate.outcome.code,
                message=estimate.message,
                advice=estimate.outcome.advice,
            )
            return
        _log.info(
            "estimate",
            loop=estimate.loop,
            verdict=found.verdict,
            score=_rounded(found.score, 1),
            stick_band=_rounded(found.stick_band.value),
            slip_jump=_rounded(found.slip_jump.value),
            r2=_rounded(found.r2),
            seconds=round(found.seconds, 3),
            reason=found.reasons[0] if found.reasons else "",
        )

    def attempt(self, loop: str, attempt: Attempt) -> None:
        """Log and store a write-back attempt."""
        record = attempt.record(loop, self._clock.utc())
        self._put(record)
        level = _log.info if attempt.outcome in _EXPECTED else _log.warning
        level(
            "writeback",
            loop=loop,
            outcome=record.outcome,
            seq=record.seq,
            bank=record.bank,
            status=record.status,
            reason=record.reason,
        )

    def begin(self, loop: str, attempt: Attempt) -> Future[bool]:
        """Store an attempt before it is made; the promise says when and whether it is stored."""
        if self._keep is not None:
            return self._keep(attempt.record(loop, self._clock.utc()))
        kept: Future[bool] = Future()
        kept.set_result(True)
        return kept

    def event(self, kind: str, source: str, message: str, *, bad: bool = False) -> None:
        """Log and store something that happened to ``source``, unless it repeats too often."""
        # In a simulation nothing else asks every second.
        self.summarize()
        if self._limit.admits(kind, source, message):
            self._tell(kind, source, message, bad=bad)

    def order(self, record: EventRecord) -> None:
        """Log and store what an operator has ordered; none of it is ever summed up."""
        self._put(record)
        _log.info(record.kind, source=record.source, message=record.message)

    def summarize(self, *, at_the_end: bool = False) -> None:
        """Tell how many events were held back, where a minute or the run is over."""
        for summary in self._limit.summaries(at_the_end=at_the_end):
            self._tell(summary.kind, summary.source, summary.message, bad=True)

    def defect(self, source: str, error: Exception, consequence: str) -> str:
        """Count an unforeseen error, and log it once for each source and cause.

        Args:
            source: the device, loop or job in whose work it was met.
            error: what was raised.
            consequence: what is done about it, as the end of a sentence.

        Returns:
            The error and its place in one line.
        """
        self.defects += 1
        found = describe_defect(error)
        if self._defects.get(source) != found:
            self._defects[source] = found
            self.event("defect", source, f"{found}; {consequence}; please report it", bad=True)
        return found

    def event_record(self, kind: str, source: str, message: str) -> EventRecord:
        """Return an event that happens now."""
        return EventRecord(round(self._clock.utc() * 1000.0), kind, source, message)

    def _tell(self, kind: str, source: str, message: str, *, bad: bool) -> None:
        self._put(self.event_record(kind, source, message))
        (_log.warning if bad else _log.info)(kind, source=source, message=message)
