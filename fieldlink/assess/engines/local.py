"""The processes of this machine: a thread and a worker process for each core."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Self

from fieldlink.assess.engines.base import Answer, Batch, NextBatch, judge_batch
from fieldlink.assess.job import Job
from fieldlink.assess.workers.watched import WatchedWorker

__all__ = ["LocalEngine"]


class LocalEngine:
    """A pool of watched workers.

    Args:
        job: what is assessed.
        workers: processes.
        started: one that runs already; it becomes the engine's.
    """

    def __init__(self, job: Job, workers: int, started: WatchedWorker) -> None:
        self._job = job
        self._started = [started]
        self._workers = workers
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="assess")
        self._own = threading.local()
        self._all = [started]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        for worker in self._all:
            worker.interrupt()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for worker in self._all:
            worker.close()

    @property
    def workers(self) -> int:
        """Processes."""
        return self._workers

    def run(self, next_batch: NextBatch) -> Iterator[Answer]:
        """Yield the answer of every batch, in any order."""
        pending: set[Future[Answer]] = set()
        while True:
            # One batch more than workers: none waits for its next one.
            while len(pending) <= self._workers and (batch := next_batch()):
                pending.add(self._threads.submit(self._judge, batch))
            if not pending:
                return
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()

    def _judge(self, batch: Batch) -> Answer:
        worker: WatchedWorker | None = getattr(self._own, "worker", None)
        if worker is None:
            worker = self._own.worker = self._new_worker()
        return judge_batch(worker, batch)

    def _new_worker(self) -> WatchedWorker:
        try:
            return self._started.pop()
        except IndexError:
            worker = WatchedWorker(self._job)
            self._all.append(worker)
            return worker
