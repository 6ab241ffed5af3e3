"""The result of an identification: immutable, with its evidence and its statistics."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from estimator.arrays import Array
from estimator.outcomes import Reason, Verdict
from loop_model import LoopModel

__all__ = ["CostSurface", "Evidence", "Fit", "Identification", "Interval", "Process", "RunnerUp"]


def _number(value: float) -> float | None:
    """A JSON number, or null where there is none (JSON has no NaN and no infinity)."""
    return float(value) if math.isfinite(value) else None


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with its interval at the result's ``confidence``; NaN where there is none."""

    value: float
    low: float
    high: float

    @classmethod
    def unknown(cls) -> Interval:
        """The interval of a quantity that this window does not show."""
        return cls(math.nan, math.nan, math.nan)

    def scaled(self, factor: float) -> Interval:
        """The same interval in other units (``factor`` may be negative)."""
        a, b = self.low * factor, self.high * factor
        return Interval(self.value * factor, min(a, b), max(a, b))

    def within(self, low: float, high: float = math.inf) -> Interval:
        """The part of the interval that can be: nothing below ``low`` or above ``high``."""
        low_, value, high_ = (min(max(v, low), high) for v in (self.low, self.value, self.high))
        return Interval(value, low_, high_)

    def around(self, value: float) -> Interval:
        """The same interval for another value, widened where it must be to hold it."""
        return Interval(value, min(self.low, value), max(self.high, value))

    def __contains__(self, value: object) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high

    def to_dict(self) -> dict[str, float | None]:
        """``{"value", "low", "high"}``."""
        return {
            "value": _number(self.value),
            "low": _number(self.low),
            "high": _number(self.high),
        }


@dataclass(frozen=True, slots=True)
class Process:
    """The identified process.

    Attributes:
        structure: in words, e.g. ``"lag"``, ``"two lags"``, ``"integrating"``, ``"arx(2,2)"``.
        parameters: by name; time constants in seconds, coefficients of PV and OP in their units.
        dead_time_samples: samples from stem to PV (0 is direct feed-through).
        gain: PV per OP in steady state with its interval; infinite for an integrating process.
    """

    structure: str
    parameters: MappingProxyType[str, float]
    dead_time_samples: int
    gain_interval: Interval

    @property
    def gain(self) -> float:
        """The gain's value."""
        return self.gain_interval.value

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "structure": self.structure,
            "parameters": {name: _number(value) for name, value in self.parameters.items()},
            "dead_time_samples": self.dead_time_samples,
            "gain": _number(self.gain),
        }


@dataclass(frozen=True, slots=True)
class Fit:
    """Share of PV's variance explained by simulation, with this valve and a healthy one."""

    r2: float
    r2_healthy_valve: float

    def to_dict(self) -> dict[str, float | None]:
        """Plain types."""
        return {"r2": _number(self.r2), "r2_healthy_valve": _number(self.r2_healthy_valve)}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the verdict rests on.

    Attributes:
        log_bayes_factor: of a sticky over a healthy valve, in nats; both judged on the same rows,
            every parameter paid for; negative where the healthy valve is likelier.
        steady: the same without the eighth of the window that holds most of it: low where one jump
            of the load makes the evidence.
        effect: share of PV's variance that the difference between stem and OP makes.
        process: log-likelihood ratio of the better hypothesis over a PV that does not follow OP.
        gain_deviations: the healthy valve's process gain over its standard deviation.
        disturbances: oscillations from outside that the healthy valve needs.
        moves: samples in which the identified stem moves; reversals: changes of direction;
            strokes: runs of moves in one direction.
        band_over_span: stick band over the span of OP in the window.
        informed: share of PV's moving samples that do not lie on a line between others.
        left_out: step from which a historian stored OP or PV, as a share of its span; 0 where every
            sample was measured.
        gain_sign: sign of the process gain that the controller's action tells, 0 where unclear.
        law: the valve law that explains the window best.
        over_waves: by how many nats a sticky valve whose slips vary by chance is likelier than a
            load that swings unevenly, or goes in steps and lines; infinite where no such load is
            likelier than the sticky valve whose slips do not vary.
    """

    log_bayes_factor: float
    steady: float
    effect: float
    process: float
    gain_deviations: float
    disturbances: int
    moves: int
    reversals: int
    strokes: int
    band_over_span: float
    informed: float
    gain_sign: int
    law: str
    left_out: float = 0.0
    over_waves: float = math.inf

    def to_dict(self) -> dict[str, float | int | str | None]:
        """Plain types, null for no number."""
        return {
            "log_bayes_factor": _number(self.log_bayes_factor),
            "steady": _number(self.steady),
            "effect": _number(self.effect),
            "process": _number(self.process),
            "gain_deviations": _number(self.gain_deviations),
            "disturbances": self.disturbances,
            "moves": self.moves,
            "reversals": self.reversals,
            "strokes": self.strokes,
            "band_over_span": _number(self.band_over_span),
            "informed": _number(self.informed),
            "left_out": _number(self.left_out),
            "gain_sign": self.gain_sign,
            "law": self.law,
            "over_waves": _number(self.over_waves),
        }


@dataclass(frozen=True, slots=True)
class RunnerUp:
    """Another explanation that was tried: how many nats it is behind the best one."""

    explanation: str
    structure: str
    dead_time_samples: int
    behind: float

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "explanation": self.explanation,
            "structure": self.structure,
            "dead_time_samples": self.dead_time_samples,
            "behind": _number(self.behind),
        }


@dataclass(frozen=True, slots=True)
class CostSurface:
    """Cost over (S, J), everything else at its best; rows are S, columns J.

    ``stick_band`` has shape ``(m,)``, ``slip_jump`` ``(k,)``, both in units of OP; ``cost`` has
    shape ``(m, k)``: mean squared error over PV's variance, NaN where ``J > S``.
    """

    stick_band: Array
    slip_jump: Array
    cost: Array


@dataclass(frozen=True, slots=True)
class Identification:
    """What one window says about valve and process (units of OP and PV as given).

    Attributes:
        verdict: the answer.
        reasons: why, each with advice.
        uncertain: whether the other verdict is possible: a sticky valve is likelier, but not by
            much, or hardly matters.
        score: log Bayes factor of a sticky over a healthy valve, in nats; never clipped, so that
            loops can be ranked by it. 0 when the window was refused before a model was tried.
        stick_band, slip_jump: S and J with intervals at ``confidence``.
        static_friction, dynamic_friction: fS = (S + J)/2 and fD = (S - J)/2, likewise.
        process, fit, criterion, evidence: what was identified, and how well.
        samples: samples of the window (rows given).
        period_s: seconds between samples.
        seconds: time that the identification took.
        model: valve and process in ARX form for the compensator; None when not assessable.
        stem, pv_model: estimated stem position and simulated PV, shape ``(samples,)``.
        surface: the cost surface, for pictures; None when not asked for or not assessable.
        runners_up: other process structures, best first.
        identifiability: what this window cannot tell, in sentences.
        criterion_reason: why the estimate is under its criterion.
    """

    verdict: Verdict
    reasons: tuple[Reason, ...]
    score: float
    stick_band: Interval
    slip_jump: Interval
    static_friction: Interval
    dynamic_friction: Interval
    confidence: float
    process: Process
    fit: Fit
    criterion: str
    evidence: Evidence
    samples: int
    period_s: float
    seconds: float
    model: LoopModel | None
    stem: Array = field(repr=False)
    pv_model: Array = field(repr=False)
    surface: CostSurface | None = field(repr=False)
    uncertain: bool = False
    runners_up: tuple[RunnerUp, ...] = ()
    identifiability: tuple[str, ...] = ()
    criterion_reason: str = ""

    @property
    def shown_score(self) -> float:
        """The score for a reader: NaN where the window was refused before a model was tried."""
        weighed = self.score != 0.0 or math.isfinite(self.evidence.log_bayes_factor)
        return self.score if weighed else math.nan

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of ``fieldlink identify --json``: plain types, null for no number."""
        return {
            "verdict": self.verdict.value,
            "uncertain": self.uncertain,
            "reasons": [reason.text for reason in self.reasons],
            "score": _number(self.score),
            "stick_band": self.stick_band.to_dict(),
            "slip_jump": self.slip_jump.to_dict(),
            "static_friction": self.static_friction.to_dict(),
            "dynamic_friction": self.dynamic_friction.to_dict(),
            "confidence": self.confidence,
            "process": self.process.to_dict(),
            "fit": self.fit.to_dict(),
            "criterion": self.criterion,
            "samples": self.samples,
            "period_s": self.period_s,
            "seconds": self.seconds,
            "reason_codes": [reason.code.value for reason in self.reasons],
            "advice": [reason.advice for reason in self.reasons],
            "evidence": self.evidence.to_dict(),
            "identifiability": list(self.identifiability),
            "runners_up": [one.to_dict() for one in self.runners_up],
        }
