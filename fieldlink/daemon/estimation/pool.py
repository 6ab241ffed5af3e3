"""The estimator in processes of its own: one that hangs or dies costs the daemon a counted failure.

A worker that exceeds its time ends itself (a watchdog thread in C, which no computation can hold
up) and leaves the place where it hung on stderr. A dead worker breaks its pool: a new pool takes
over, and the windows that were only bystanders are judged again. A worker gets no more memory than
it is given, and an error in it, whatever it is, is an outcome of its window.
"""

from __future__ import annotations

import asyncio
import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from typing import ParamSpec, TypeVar

import structlog

from fieldlink.daemon.estimation.answers import Answer
from fieldlink.daemon.estimation.estimating import (
    Estimate,
    EstimateOutcome,
    EstimateRequest,
    estimate,
    warm_up,
)
from fieldlink.daemon.estimation.fork_server import end_fork_server, worker_context
from fieldlink.daemon.estimation.priority import stand_back
from fieldlink.daemon.reporting.defects import describe_defect

__all__ = ["EstimatorPool", "PoolReport", "PoolSettings", "begin_worker"]

_log = structlog.get_logger(__name__)

P = ParamSpec("P")
T = TypeVar("T")
A = TypeVar("A")


@dataclass(frozen=True, slots=True)
class PoolSettings:
    """How many workers and how patient to be.

    Attributes:
        workers: processes; one core is left to the daemon by default.
        limit: seconds that one window may take in a worker.
        grace: seconds beyond the limits of all windows ahead before a worker counts as lost.
        preparing: seconds that the first window of new workers may take longer: they compile the
            kernels where none are kept yet, which takes minutes on a slow or loaded machine.
        memory: bytes of data that a worker may hold; no bound when None.
        stands_back: whether workers let everything else on the machine go first.
    """

    workers: int = max(1, (os.cpu_count() or 2) - 1)
    limit: float = 60.0
    grace: float = 10.0
    preparing: float = 900.0
    memory: int | None = 1_500_000_000
    stands_back: bool = True


@dataclass(frozen=True, slots=True)
class PoolReport:
    """What the pool has done.

    Attributes:
        judged: windows by outcome code.
        rebuilt: times the processes were replaced.
        waiting: windows that are being judged or wait for it.
        workers: processes that run now.
    """

    judged: Mapping[str, int] = field(default_factory=dict)
    rebuilt: int = 0
    waiting: int = 0
    workers: int = 0


class _PoolGoneError(Exception):
    """The pool that was to judge a window has been replaced."""


class EstimatorPool:
    """An `Estimator` over a process pool that is replaced when it breaks.

    Args:
        settings: size and patience.
        work: what a worker does with a request; a function of a module, because it is pickled.
        prepare: what a worker does first.
    """

    def __init__(
        self,
        settings: PoolSettings | None = None,
        work: Callable[[EstimateRequest], Estimate] = estimate,
        prepare: Callable[[], None] = warm_up,
    ) -> None:
        self._settings = settings or PoolSettings()
        self._work = work
        self._prepare = prepare
        self._pool = self._new_pool()
        self._prepared: ProcessPoolExecutor | None = None
        self._in_flight = 0
        self._second_attempts = asyncio.Lock()
        self._judged: Counter[str] = Counter()
        self._submitting: set[int] = set()
        self._closing = False
        self.rebuilt = 0

    async def warm_up(self) -> None:
        """Start the workers and let each load its kernels."""
        begun = await asyncio.gather(
            *(self._submit(_nothing) for _ in range(self._settings.workers)),
            return_exceptions=True,
        )
        for error in begun:
            if isinstance(error, BaseException):
                _log.error("estimator.warm_up_failed", error=repr(error))

    async def run(self, request: EstimateRequest) -> Estimate:
        """Judge a window; a window whose worker dies is judged once more in a new pool."""
        answer = await self.call(self._work, request)
        estimate = answer.value
        if estimate is None:
            estimate = Estimate.failed(request, answer.outcome, answer.message)
        self._judged[estimate.outcome.code] += 1
        return estimate

    async def call(self, work: Callable[[A], T], task: A) -> Answer[T]:
        """Have a worker do something; it is tried once more when the worker dies.

        Args:
            work: a function of a module, because it is pickled.
            task: its argument; it and what comes back are pickled.
        """
        answer = await self._attempt(work, task)
        if answer.outcome is EstimateOutcome.WORKER_DIED:
            # One at a time: the window that killed the worker must not take a bystander along
            # again.
            async with self._second_attempts:
                answer = await self._attempt(work, task)
        return answer

    def report(self) -> PoolReport:
        """Return the counts up to now."""
        return PoolReport(
            dict(self._judged), self.rebuilt, self._in_flight, len(_processes(self._pool))
        )

    async def _attempt(self, work: Callable[[A], T], task: A) -> Answer[T]:
        pool, limit = self._pool, self._settings.limit
        self._in_flight += 1
        turns = -(-self._in_flight // self._settings.workers)
        bound = turns * limit + self._settings.grace
        if pool is not self._prepared:
            bound += self._settings.preparing
        try:
            return await asyncio.wait_for(self._submit(_bounded, work, task, limit), timeout=bound)
        except TimeoutError:
            # The worker's own watchdog did not fire: it is stopped or starved from outside.
            self._replace(pool, kill=True)
            return Answer(EstimateOutcome.TIMED_OUT, f"no result within {bound:g} s")
        except (BrokenProcessPool, _PoolGoneError):
            self._replace(pool, kill=False)
            return Answer(
                EstimateOutcome.WORKER_DIED,
                f"the estimator's process ended, or needed more than {limit:g} s",
            )
        finally:
            self._in_flight -= 1

    async def close(self) -> None:
        """End the workers; what they are doing is lost."""
        self._closing = True
        _kill(self._pool)
        await asyncio.to_thread(self._shut_down)

    def _shut_down(self) -> None:
        # A thread that waits for the first import would hold up the pool, and the daemon's end.
        while self._submitting:
            end_fork_server()
            time.sleep(0.02)
        # Workers that came meanwhile.
        _kill(self._pool)
        self._pool.shutdown(wait=True, cancel_futures=True)

    def worker_ids(self) -> tuple[int, ...]:
        """Return the process ids of the workers that run now."""
        return tuple(_processes(self._pool))

    async def _submit(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        # In a thread: the first submission waits until the fork server has loaded the estimator.
        pool = self._pool
        try:
            task = partial(function, *args, **kwargs)
            future = await asyncio.to_thread(self._hand_over, pool, task)
        except RuntimeError as error:
            # It was replaced between the choice and the submission.
            raise _PoolGoneError from error
        result = await asyncio.wrap_future(future)
        self._prepared = pool
        return result

    def _hand_over(self, pool: ProcessPoolExecutor, task: Callable[[], T]) -> Future[T]:
        this = threading.get_ident()
        self._submitting.add(this)
        try:
            if self._closing:
                raise _PoolGoneError
            return pool.submit(task)
        except (EOFError, OSError) as error:
            if self._closing:
                raise _PoolGoneError from error
            raise
        finally:
            self._submitting.discard(this)

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._settings.workers,
            mp_context=worker_context(),
            initializer=begin_worker,
            initargs=(self._prepare, self._settings.memory, self._settings.stands_back),
        )

    def _replace(self, broken: ProcessPoolExecutor, *, kill: bool) -> None:
        if broken is not self._pool:
            return
        self.rebuilt += 1
        _log.warning("estimator.pool_rebuilt", times=self.rebuilt, killed=kill)
        self._pool = self._new_pool()
        if kill:
            _kill(broken)
        broken.shutdown(wait=False, cancel_futures=True)


def _processes(pool: ProcessPoolExecutor) -> dict[int, multiprocessing.process.BaseProcess]:
    # Public names for this (terminate_workers, kill_workers) come with Python 3.14.
    return dict(getattr(pool, "_processes", None) or {})


def _kill(pool: ProcessPoolExecutor) -> None:
    for process in _processes(pool).values():
        process.kill()


def begin_worker(prepare: Callable[[], None], memory: int | None, stands_back: bool = True) -> None:
    """First thing in a worker: the daemon goes first and decides when it ends; then the kernels."""
    if memory is not None and sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    if stands_back:
        stand_back()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, name="parent", daemon=True).start()
    prepare()


def _die_with_parent() -> None:
    """End this worker with its daemon: otherwise it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _bounded(work: Callable[[A], T], task: A, limit: float) -> Answer[T]:
    faulthandler.dump_traceback_later(limit, exit=True)
    try:
        return Answer(EstimateOutcome.ESTIMATED, value=work(task))
    except MemoryError as error:
        return Answer(EstimateOutcome.OUT_OF_MEMORY, str(error) or "no memory")
    except Exception as error:  # noqa: BLE001  (it is reported; the daemon must not end by it)
        return Answer(EstimateOutcome.FAILED, describe_defect(error))
    finally:
        faulthandler.cancel_dump_traceback_later()


def _nothing() -> None:
    """Work for a worker that is only to be started."""
