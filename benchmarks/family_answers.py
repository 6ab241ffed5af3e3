"""What the estimator answers on the report family, one loop at a time, and counts of it.

A right answer names the valve as it is, an uncertain one counts as half an error, and a window that
is declined is counted beside the errors, because a method that always declines makes none.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.families.loop import RecordedLoop
from benchmarks.families.report import KINDS, draw
from estimator import Identification, Verdict, identify, warm_up

__all__ = ["Answer", "Counts", "Loop", "answer", "answers", "count", "loops_of"]

Loop = tuple[str, bool, int]
"""Kind, whether sticky, seed."""

HALF = 0.5
"""Share of an error that an uncertain answer counts."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The truth about one loop and the estimator's answer; times are of the processor."""

    kind: str
    law: str
    seed: int
    is_sticky: bool
    is_assessable: bool
    verdict: str
    is_uncertain: bool
    score: float
    reasons: tuple[str, ...]
    true_band: float
    true_jump: float
    band: tuple[float, float, float]
    """S with its 90 % interval, NaN where there is none."""
    jump: tuple[float, float, float]
    milliseconds: float

    @property
    def is_declined(self) -> bool:
        """Whether there was no verdict on the valve."""
        return self.verdict == Verdict.NOT_ASSESSABLE.value

    @property
    def is_called_sticky(self) -> bool:
        """Whether the verdict was stiction, certain or not."""
        return self.verdict == Verdict.STICTION.value

    @property
    def error(self) -> float:
        """1 for a wrong verdict, a half for an uncertain one, else 0."""
        if self.is_declined:
            return 0.0
        if self.is_uncertain:
            return HALF
        return float(self.is_called_sticky != self.is_sticky)


def _is_uncertain(result: Identification) -> bool:
    # An estimator without that answer is certain of every verdict.
    return bool(getattr(result, "uncertain", False))


def _answer_about(loop: RecordedLoop, seed: int) -> Answer:
    with threadpool_limits(limits=1):
        begun = time.process_time()
        result = identify(loop.op, loop.pv, sp=loop.sp, period=loop.period)
        seconds = time.process_time() - begun
    band, jump = result.stick_band, result.slip_jump
    return Answer(
        kind=loop.kind,
        law=loop.law,
        seed=seed,
        is_sticky=loop.stick_band > 0.0,
        is_assessable=loop.assessable,
        verdict=result.verdict.value,
        is_uncertain=_is_uncertain(result),
        score=float(result.score),
        reasons=tuple(reason.code.value for reason in result.reasons),
        true_band=loop.stick_band,
        true_jump=loop.slip_jump,
        band=(band.value, band.low, band.high),
        jump=(jump.value, jump.low, jump.high),
        milliseconds=1e3 * seconds,
    )


def answer(loop: Loop) -> Answer:
    """Draw one loop and judge it."""
    kind, sticky, seed = loop
    return _answer_about(draw(kind, sticky, seed), seed)


def loops_of(kinds: Iterable[str], loops: int, seed_base: int) -> list[Loop]:
    """``loops`` healthy and as many sticky ones of every kind that has both."""
    return [
        (kind, sticky, seed_base + i)
        for kind in kinds
        for sticky in (False, True)
        if (KINDS[kind].sticky if sticky else KINDS[kind].healthy)
        for i in range(loops)
    ]


def answers(loops: Sequence[Loop], jobs: int) -> list[Answer]:
    """The answers to ``loops``, in order, from ``jobs`` processes."""
    if jobs == 1:
        warm_up()
        return [answer(loop) for loop in loops]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=warm_up) as pool:
        return list(pool.map(answer, loops, chunksize=4))


@dataclass(frozen=True, slots=True)
class Counts:
    """Verdicts on a set of answers, and how good S, J and their intervals are.

    Errors of S and J are medians, both as a share of the true S; coverage is of 90 % intervals
    among the sticky loops called sticky. NaN where there is no such loop.
    """

    healthy: int
    accused: int
    healthy_uncertain: int
    healthy_declined: int
    sticky: int
    missed: int
    sticky_uncertain: int
    sticky_declined: int
    hopeless: int
    """Loops whose record does not hold what any method needs."""
    hopeless_declined: int
    hopeless_accused: int
    errors: float
    """Wrong verdicts on assessable loops, an uncertain one as a half."""
    band_error: float
    jump_error: float
    band_coverage: float
    jump_coverage: float
    intervals: int
    """Sticky loops called sticky, over which S, J and coverage are counted."""
    band_width: float
    """Median width of S's interval as a share of the true S."""
    mean_ms: float
    p95_ms: float


def _median(values: Iterable[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan


def _share(flags: Sequence[bool]) -> float:
    return float(np.mean(flags)) if flags else math.nan


def count(found: Sequence[Answer]) -> Counts:
    """Count ``found``, of one kind or of many."""
    fair = [a for a in found if a.is_assessable]
    hopeless = [a for a in found if not a.is_assessable]
    healthy = [a for a in fair if not a.is_sticky]
    sticky = [a for a in fair if a.is_sticky]
    hit = [a for a in sticky if a.is_called_sticky]
    times = [a.milliseconds for a in found]
    return Counts(
        healthy=len(healthy),
        accused=sum(a.error == 1.0 for a in healthy),
        healthy_uncertain=sum(a.error == HALF for a in healthy),
        healthy_declined=sum(a.is_declined for a in healthy),
        sticky=len(sticky),
        missed=sum(a.error == 1.0 for a in sticky),
        sticky_uncertain=sum(a.error == HALF for a in sticky),
        sticky_declined=sum(a.is_declined for a in sticky),
        hopeless=len(hopeless),
        hopeless_declined=sum(a.is_declined for a in hopeless),
        hopeless_accused=sum(a.is_called_sticky and not a.is_sticky for a in hopeless),
        errors=sum(a.error for a in fair),
        band_error=_median(abs(a.band[0] - a.true_band) / a.true_band for a in hit),
        jump_error=_median(abs(a.jump[0] - a.true_jump) / a.true_band for a in hit),
        band_coverage=_share([a.band[1] <= a.true_band <= a.band[2] for a in hit]),
        jump_coverage=_share([a.jump[1] <= a.true_jump <= a.jump[2] for a in hit]),
        intervals=len(hit),
        band_width=_median((a.band[2] - a.band[1]) / a.true_band for a in hit),
        mean_ms=float(np.mean(times)),
        p95_ms=float(np.quantile(times, 0.95)),
    )
