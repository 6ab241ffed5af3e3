"""Computations for the pages that need the estimator: in one process of low priority, one by one.

The daemon's own process stays without the estimator's kernels, and no computation of a page holds
up a poll or a window: the process stands back like the estimator's own workers, has a bound on time
and memory, and is replaced when it ends.
"""

from __future__ import annotations

import contextlib
import faulthandler
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

import structlog

from fieldlink.daemon.estimation.fork_server import end_fork_server, worker_context
from fieldlink.daemon.estimation.pool import begin_worker

__all__ = ["Analyst", "Course", "Explanation", "Point", "WindowSamples"]

_log = structlog.get_logger(__name__)

LIMIT = 60.0
"""Seconds for one task: the time that the daemon gives a window."""

MEMORY = 1_500_000_000
"""Bytes for the process: what the daemon gives a worker."""

BATCH = 3
"""Courses in one task: about a second, for which a map that is asked for has to wait."""

KEPT = 8
"""Explanations that are kept: those of the loops that somebody looks at now."""

Point = tuple[float, float, float, float, float, float, float]
"""Seconds, then S and J, each with the bounds of its interval; NaN for what is unknown."""

Floats = list[float | None]


@dataclass(frozen=True, slots=True)
class Course:
    """A valve over its windows; see `estimator.track`.

    Attributes:
        trend_per_week, days_to_limit: of the stick band: value, low, high; None where unknown.
        level: smoothed stick band with its bounds, one triple a point.
        changes: kind (``increase`` or ``decrease``) and second of each change.
    """

    trend_per_week: tuple[float | None, ...]
    days_to_limit: tuple[float | None, ...]
    level: list[tuple[float | None, ...]]
    changes: list[tuple[str, float]]


@dataclass(frozen=True, slots=True)
class WindowSamples:
    """A window as the estimator takes it: lists with NaN for what is missing."""

    op: list[float]
    pv: list[float]
    sp: list[float] | None
    auto: list[float] | None
    period: float
    criterion: str
    confidence: float


@dataclass(frozen=True, slots=True)
class Explanation:
    """The curves behind a verdict: stem and model over the window, cost over S and J."""

    stem: Floats
    pv_model: Floats
    stick_band: Floats
    slip_jump: Floats
    cost: list[Floats]


class Analyst:
    """Runs the pages' computations; every method may be called from any thread.

    One thread hands the tasks over, each when the one before is done: starting the process takes
    seconds, and no request waits for that.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # Of its own: no request waits while the process is started.
        self._pool_lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._hands = ThreadPoolExecutor(1, thread_name_prefix="analyst")
        self._waiting: deque[tuple[str, list[Point], float | None]] = deque()
        self._courses: dict[str, Course | None] = {}
        self._at_work = False
        self._is_closing = False
        self._is_starting = False
        self._explained: dict[tuple[str, int], Future[Explanation]] = {}

    def close(self) -> None:
        """End the process; what it is doing is lost."""
        self._hands.shutdown(wait=False, cancel_futures=True)
        self._is_closing = True
        while self._is_starting:  # else its first import would be waited for
            end_fork_server()
            time.sleep(0.02)
        with self._pool_lock:
            pool = self._pool
        with self._lock:
            self._waiting.clear()
        if pool is not None:
            for process in dict(getattr(pool, "_processes", None) or {}).values():
                process.kill()
            pool.shutdown(wait=True, cancel_futures=True)
        self._hands.shutdown(wait=True)

    def course(
        self, key: str, points: Callable[[], list[Point]], limit: float | None
    ) -> Course | None:
        """Return the course of a valve; None while it is being computed, or where it cannot be.

        Args:
            key: names the loop and its newest point; another key is another computation.
            points: gives the points when they are needed, oldest first.
            limit: the stick band's, units of OP.
        """
        with self._lock:
            if key not in self._courses:
                self._courses[key] = None
                self._waiting.append((key, points(), limit))
                if not self._at_work:
                    self._at_work = True
                    self._hands.submit(self._follow_batch)
            return self._courses[key]

    def forget(self, key: str) -> None:
        """Drop a course that is not asked for any more."""
        with self._lock:
            self._courses.pop(key, None)

    def explain(self, loop: str, number: int, samples: WindowSamples) -> Future[Explanation]:
        """Return the curves behind an estimate when they are ready; the newest few are kept."""
        with self._lock:
            known = self._explained.get((loop, number))
            if known is None or (known.done() and known.exception() is not None):
                while len(self._explained) >= KEPT:
                    del self._explained[next(iter(self._explained))]
                known = self._hands.submit(self._run, explain_window, samples)
                self._explained[loop, number] = known
            return known

    def _follow_batch(self) -> None:
        with self._lock:
            batch = [self._waiting.popleft() for _ in range(min(BATCH, len(self._waiting)))]
        try:
            found = self._run(follow_valves, batch)
        except Exception as error:  # noqa: BLE001  (told; the table goes on without these trends)
            if self._is_closing:
                return
            _log.warning(
                "web.course_failed",
                loops=[key.partition("\0")[0] for key, _, _ in batch],
                error=_cause_of(error),
                advice="the trends of these loops stay empty until their next estimate",
            )
            found = {}
        with self._lock:
            self._courses |= {key: value for key, value in found.items() if key in self._courses}
            self._at_work = bool(self._waiting)
            if self._at_work:
                with contextlib.suppress(RuntimeError):  # the server is ending
                    self._hands.submit(self._follow_batch)

    def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a task in the process, which is replaced when it has ended."""
        try:
            with self._pool_lock:
                self._is_starting = True
                try:
                    if self._is_closing:
                        raise BrokenProcessPool("the server is ending")
                    if self._pool is None:
                        self._pool = _new_pool()
                    task = self._pool.submit(_bounded, LIMIT, function, *arguments)
                finally:
                    self._is_starting = False
            return task.result()
        except BrokenProcessPool:
            with self._pool_lock:
                self._pool = None
            raise


def _new_pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        1, mp_context=worker_context(), initializer=begin_worker, initargs=(_nothing, MEMORY)
    )


def _cause_of(error: Exception) -> str:
    if isinstance(error, BrokenProcessPool):
        return (
            f"the process that computes trends ended: over {LIMIT:g} s, over "
            f"{MEMORY / 1e9:g} GB of memory, or stopped from outside"
        )
    return str(error) or "no cause given"


def _nothing() -> None:
    """The kernels are loaded by the first task that needs them."""


def _bounded(limit: float, function: Callable[..., Any], *arguments: Any) -> Any:
    faulthandler.dump_traceback_later(limit, exit=True)
    try:
        return function(*arguments)
    finally:
        faulthandler.cancel_dump_traceback_later()


def follow_valves(
    batch: Sequence[tuple[str, list[Point], float | None]],
) -> dict[str, Course | None]:
    """Follow several valves; None for one whose points say nothing."""
    return {key: _follow(points, limit) for key, points, limit in batch}


def _follow(points: list[Point], limit: float | None) -> Course | None:
    from estimator import EstimatorError, Interval, track

    try:
        course = track(
            [point[0] for point in points],
            [Interval(*point[1:4]) for point in points],
            [Interval(*point[4:7]) for point in points],
            stick_band_limit=limit,
        )
    except EstimatorError:
        return None
    S = course.stick_band
    trend, days = S.trend_per_day, S.days_to_limit
    return Course(
        tuple(_plain(7.0 * value) for value in (trend.value, trend.low, trend.high)),
        tuple(_plain(value) for value in (days.value, days.low, days.high)),
        [
            (_plain(v), _plain(low), _plain(high))
            for v, low, high in zip(S.value, S.low, S.high, strict=True)
        ],
        [(change.kind.value, float(S.times[change.onset])) for change in S.changes],
    )


def explain_window(samples: WindowSamples) -> Explanation:
    """Judge a window once more, with its curves and its cost over S and J."""
    import numpy as np

    from estimator import identify

    def vector(values: list[float] | None) -> Any:
        return None if values is None else np.asarray(values, dtype=np.float64)

    result = identify(
        vector(samples.op),
        vector(samples.pv),
        sp=vector(samples.sp),
        auto=vector(samples.auto),
        period=samples.period,
        criterion=samples.criterion,
        confidence=samples.confidence,
        surface=True,
    )
    surface = result.surface
    return Explanation(
        _list(result.stem),
        _list(result.pv_model),
        [] if surface is None else _list(surface.stick_band),
        [] if surface is None else _list(surface.slip_jump),
        [] if surface is None else [_list(row) for row in surface.cost],
    )


def _list(values: Any) -> Floats:
    return [_plain(value) for value in values]


def _plain(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
