"""The task of a Dask cluster: judge a batch in a worker process of the thread that runs the task.

A task starts a watched worker process on its machine, once for each of the machine's Dask threads,
so that a window that kills its process never kills a Dask worker.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from fieldlink.assess.engines.base import Answer, judge_batch
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.run_file import Task
from fieldlink.assess.workers.watched import WatchedWorker

__all__ = ["end_workers", "hand_over", "judge_remotely"]

IDLE = 120.0
"""Seconds after its last batch until a worker process on a cluster ends; its client may be gone."""


def judge_remotely(job: str, batch: Sequence[tuple[int, dict[str, Any]]]) -> Answer:
    """The task: judge a batch in this thread's worker process."""
    tasks = [Task(number, Piece.of(plain)) for number, plain in batch]
    key = threading.get_ident()
    with _lock:
        known, worker, timer = _own.pop(key, (job, None, None))
        if worker is None and _handed_over:
            known, worker = _handed_over.pop()
    if timer is not None:
        timer.cancel()
    if worker is not None and known != job:
        worker.close()
        worker = None
    if worker is None:
        worker = WatchedWorker(Job.from_json(job))
    try:
        answer = judge_batch(worker, tasks)
    except BaseException:
        worker.close()
        raise
    timer = threading.Timer(IDLE, _end_worker, (key, worker))
    timer.daemon = True
    with _lock:
        _own[key] = (job, worker, timer)
    timer.start()
    return answer


_own: dict[int, tuple[str, WatchedWorker, threading.Timer]] = {}
"""In a Dask worker: the idle worker process of each thread, for the next batch."""

_handed_over: list[tuple[str, WatchedWorker]] = []
"""In a cluster of this process: worker processes that are warm already, each with its job."""

_lock = threading.Lock()


def _end_worker(key: int, worker: WatchedWorker) -> None:
    """End a thread's worker process unless it was taken for a batch meanwhile."""
    with _lock:
        if key not in _own or _own[key][1] is not worker:
            return
        del _own[key]
    worker.close()


def hand_over(job: str, worker: WatchedWorker) -> None:
    """Let a cluster in this process go on with a worker process that runs already."""
    with _lock:
        _handed_over.append((job, worker))


def end_workers() -> None:
    """End all idle worker processes: the client is done."""
    with _lock:
        idle = list(_own.values())
        _own.clear()
        handed_over = list(_handed_over)
        _handed_over.clear()
    for _, worker, timer in idle:
        timer.cancel()
        worker.close()
    for _, worker in handed_over:
        worker.close()
