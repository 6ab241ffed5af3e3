"""A window goes in, what the estimator says comes out, whatever happens to the estimator.

`estimate` runs in a worker process as well as inline. What crosses the process border is small and
plain: the figures, the model for the compensator and the JSON document, not the curves of pictures.
The estimator is loaded where it runs: the daemon's own process does without its kernels and their
memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Protocol

from fieldlink.daemon.windows.window import WindowData
from fieldlink.store import EstimateRecord
from loop_model import LoopModel

if TYPE_CHECKING:
    from estimator import Identification
    from estimator import Interval as EstimatorInterval

__all__ = [
    "Estimate",
    "EstimateOutcome",
    "EstimateRequest",
    "Estimator",
    "Findings",
    "InlineEstimator",
    "Interval",
    "estimate",
    "warm_up",
]


@dataclass(frozen=True, slots=True)
class EstimateRequest:
    """A window of a loop and how to judge it; see `estimator.identify`.

    Attributes:
        epoch: of the loop's runner that asks; a result for another epoch is dropped.
        asked_at: the plant second of the request.
        compensated: whether a block may have been in force during the window.
        by_hand: whether an operator asked for it; its result is shown and stored and counts for no
            write-back.
    """

    loop: str
    window: WindowData
    period: float
    criterion: str = "auto"
    confidence: float = 0.9
    epoch: int = 0
    asked_at: float = 0.0
    compensated: bool = False
    by_hand: bool = False


class EstimateOutcome(Enum):
    """The outcome of a request; the value is stored, ``advice`` is for the operator."""

    ESTIMATED = ("estimated", "")
    REFUSED = ("refused", "the estimator cannot use the window: check the loop's tags")
    TIMED_OUT = ("timed_out", "shorten the window, or give the machine more time or cores")
    OUT_OF_MEMORY = ("out_of_memory", "shorten the window, or raise estimation.memory_megabytes")
    FAILED = ("failed", "a defect of the estimator: report it with the window's samples")
    WORKER_DIED = ("worker_died", "look for a memory limit or a killed process; it is tried again")

    def __init__(self, code: str, advice: str) -> None:
        self.code = code
        self.advice = advice


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and its bounds in units of OP; NaN where the window does not tell."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, interval: EstimatorInterval) -> Interval:
        """Take over an interval of the estimator."""
        return cls(float(interval.value), float(interval.low), float(interval.high))


@dataclass(frozen=True, slots=True)
class Findings:
    """What the estimator found: the part of its result that the daemon acts on.

    Attributes:
        verdict: ``stiction``, ``no_stiction`` or ``not_assessable``.
        reasons: why, in sentences.
        score: evidence for stiction.
        stick_band, slip_jump, static_friction, dynamic_friction: S, J, fS, fD.
        confidence: of the intervals.
        r2: share of PV's variance explained.
        criterion: the criterion used.
        samples: rows of the window.
        seconds: what it took.
        model: valve and process for a compensator, None when there is none.
        document: the whole result as ``fieldlink identify --json`` prints it.
        uncertain: whether the estimator itself doubts the figures; they are not written then.
    """

    verdict: str
    reasons: tuple[str, ...]
    score: float
    stick_band: Interval
    slip_jump: Interval
    static_friction: Interval
    dynamic_friction: Interval
    confidence: float
    r2: float
    criterion: str
    samples: int
    seconds: float
    model: LoopModel | None
    document: Mapping[str, object]
    uncertain: bool = False

    @classmethod
    def of(cls, result: Identification) -> Findings:
        """Take over a result of the estimator."""
        return cls(
            verdict=result.verdict.value,
            reasons=tuple(reason.text for reason in result.reasons),
            score=float(result.score),
            uncertain=bool(result.uncertain),
            stick_band=Interval.of(result.stick_band),
            slip_jump=Interval.of(result.slip_jump),
            static_friction=Interval.of(result.static_friction),
            dynamic_friction=Interval.of(result.dynamic_friction),
            confidence=float(result.confidence),
            r2=float(result.fit.r2),
            criterion=result.criterion,
            samples=int(result.samples),
            seconds=float(result.seconds),
            model=result.model,
            document=result.to_dict(),
        )


@dataclass(frozen=True, slots=True)
class Estimate:
    """A request's outcome.

    Attributes:
        loop: the loop's name.
        first_slot, last_slot: the window's slots.
        end_utc: end of the window, seconds since 1970.
        outcome: how it ended.
        message: the cause when it is not `EstimateOutcome.ESTIMATED`, else empty.
        findings: the result, None without one.
    """

    loop: str
    first_slot: int
    last_slot: int
    end_utc: float
    outcome: EstimateOutcome
    message: str = ""
    findings: Findings | None = None

    @classmethod
    def failed(cls, request: EstimateRequest, outcome: EstimateOutcome, message: str) -> Estimate:
        """Return the outcome of a request that brought no result."""
        window = request.window
        return cls(
            request.loop, window.first_slot, window.last_slot, window.end_utc, outcome, message
        )

    def record(self, utc: float) -> EstimateRecord:
        """Return what to store; ``utc`` is the moment the result came, seconds since 1970."""
        record = EstimateRecord(
            loop=self.loop,
            utc_ms=round(utc * 1000.0),
            window_end_ms=round(self.end_utc * 1000.0),
            first_slot=self.first_slot,
            last_slot=self.last_slot,
            outcome=self.outcome.code,
            message=f"{self.message}; {self.outcome.advice}",
        )
        found = self.findings
        if found is None:
            return record
        return replace(
            record,
            message="; ".join(found.reasons),
            verdict=found.verdict,
            score=found.score,
            stick_band=found.stick_band.value,
            stick_band_low=found.stick_band.low,
            stick_band_high=found.stick_band.high,
            slip_jump=found.slip_jump.value,
            slip_jump_low=found.slip_jump.low,
            slip_jump_high=found.slip_jump.high,
            confidence=found.confidence,
            r2=found.r2,
            criterion=found.criterion,
            seconds=found.seconds,
            document=found.document,
        )


class Estimator(Protocol):
    """Runs requests: a pool of processes, or the caller's own thread."""

    async def run(self, request: EstimateRequest) -> Estimate:
        """Return the outcome; never raises for what a window or a worker does."""
        ...


class InlineEstimator:
    """Runs requests in the caller's thread: deterministic, for lockstep runs."""

    async def run(self, request: EstimateRequest) -> Estimate:
        """Return the outcome."""
        return estimate(request)


def warm_up() -> None:
    """Load the estimator's kernels; those of a diagnosis, which nothing waits for, come with it."""
    import numpy as np

    import estimator
    from fieldlink.daemon.estimation.window_figures import window_figures

    estimator.warm_up()
    ramp = np.arange(64.0)
    window_figures(WindowData(ramp, ramp, None, None, 0, 63, 0.0), 1.0)


def estimate(request: EstimateRequest) -> Estimate:
    """Judge one window."""
    from estimator import EstimatorError, identify
    from fieldlink.daemon.estimation.window_figures import window_figures

    window = request.window
    try:
        result = identify(
            window.op,
            window.pv,
            sp=window.sp,
            auto=window.auto,
            period=request.period,
            criterion=request.criterion,
            confidence=request.confidence,
        )
    except EstimatorError as error:
        return Estimate.failed(request, EstimateOutcome.REFUSED, str(error))
    findings = Findings.of(result)
    figures = window_figures(window, request.period)
    return Estimate(
        request.loop,
        window.first_slot,
        window.last_slot,
        window.end_utc,
        EstimateOutcome.ESTIMATED,
        findings=replace(findings, document={**findings.document, "window": figures}),
    )
