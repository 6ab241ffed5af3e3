"""A Dask cluster: the same batches and the same workers, on any number of machines.

What the cluster loses is asked again: a Dask worker that died, or all of it when the scheduler was
started again.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from fieldlink.assess.engines.base import Answer, Batch, NextBatch
from fieldlink.assess.engines.dask_task import end_workers, hand_over, judge_remotely
from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import Job
from fieldlink.assess.workers.watched import WatchedWorker, WorkerClosedError

__all__ = ["DaskEngine"]

CONNECT = 30.0
"""Seconds to wait for a scheduler, at the start and when it was lost, and for its first worker."""

TRIES = 10
"""Times a batch is asked for again. Windows cannot kill a Dask worker, so each loss is a machine's
or an operator's doing, and ten in a row are a cluster that does not work."""

QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""What a cluster of this machine does without: Dask's profiler looks at every thread a hundred
times a second, its event loops tick fifty times, for a dashboard that is not there."""

RETRY = 0.2
"""Seconds between two looks at a client that connects again."""

WAITING = 2
"""Batches for each Dask thread: one is judged, one waits for it to be done."""


class DaskEngine:
    """A client of a scheduler, or of a cluster of its own on this machine.

    Args:
        job: what is assessed.
        scheduler: address such as ``tcp://10.0.0.5:8786``; None starts a cluster here, on loopback.
        workers: processes of a cluster here.
        started: a worker process that runs already; a cluster here goes on with it, one elsewhere
            has no use for it, and it is ended.

    Raises:
        AssessError: `distributed` is not installed, or no scheduler or worker answers.
    """

    def __init__(
        self, job: Job, scheduler: str | None, workers: int, started: WatchedWorker
    ) -> None:
        try:
            import dask
            import distributed
        except ImportError as error:
            raise AssessError(
                "--engine dask needs distributed; pip install 'fieldlink[dask]' on every machine"
            ) from error
        # Its client logs tracebacks of what is raised, or mended, here.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._job = job.to_json()
        self._lib: Any = distributed
        self._where = scheduler or "this machine"
        self._threads = 1
        self._cluster: Any = None
        try:
            if scheduler is None:
                with dask.config.set(QUIET):
                    self._cluster = distributed.LocalCluster(  # type: ignore[no-untyped-call]
                        # The work is done in worker processes of ours: threads that wait for them
                        # will do, and spare a process for each and one that watches it.
                        n_workers=1,
                        threads_per_worker=workers,
                        processes=False,
                        protocol="tcp",
                        host="127.0.0.1",
                        dashboard_address=None,
                        memory_limit=None,
                        silence_logs=logging.CRITICAL,
                    )
            self._client: Any = distributed.Client(  # type: ignore[no-untyped-call]
                self._cluster if scheduler is None else scheduler,
                timeout=CONNECT,
                set_as_default=False,
            )
        except Exception as error:
            # What answers need not be a scheduler, or may end at any byte of its answer.
            self._close_cluster()
            raise AssessError(
                f"no Dask scheduler answers at {self._where} ({_said(error)}); start one with dask "
                "scheduler, or check --scheduler"
            ) from error
        try:
            self._wait_for_workers()
        except AssessError:
            self._client.close(timeout=2.0)  # type: ignore[no-untyped-call]
            self._close_cluster()
            raise
        self._started = started
        if scheduler is None:
            hand_over(self._job, started)
        else:
            started.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            # A thread of a cluster here may wait for it.
            self._started.interrupt()
            end_workers()
        elif self._client.status == "running":
            # Without the scheduler, idle worker processes end by themselves.
            with suppress(OSError, TimeoutError):
                self._client.run(end_workers, on_error="ignore")
        self._client.close(timeout=2.0)
        self._close_cluster()

    @property
    def workers(self) -> int:
        """Threads of the cluster, as far as it can be asked now."""
        try:
            self._threads = sum(self._client.nthreads().values()) or 1
        except OSError:
            # The scheduler is gone: the batches that it had will say so.
            return self._threads
        return self._threads

    def run(self, next_batch: NextBatch) -> Iterator[Answer]:
        """Yield the answer of every batch, in any order."""
        from distributed import as_completed

        asked: dict[str, tuple[Batch, int]] = {}
        done = as_completed([], loop=self._client.loop)  # type: ignore[no-untyped-call]
        self._fill(asked, done, next_batch)
        while asked:
            future = next(done)
            batch, tries = asked.pop(future.key)
            answer = self._answer_of(future)
            if answer is None:
                self._refuse_defects(future, tries)
                self._wait_for_workers()
                self._ask(asked, done, batch, tries + 1)
            else:
                yield answer
            del future
            self._fill(asked, done, next_batch)

    def _fill(self, asked: dict[str, Any], done: Any, next_batch: NextBatch) -> None:
        most = WAITING * self.workers
        while len(asked) < most and (batch := next_batch()):
            self._ask(asked, done, batch, 0)

    def _ask(self, asked: dict[str, Any], done: Any, batch: Batch, tries: int) -> None:
        plain = [(task.number, task.piece.plain()) for task in batch]
        try:
            future = self._client.submit(judge_remotely, self._job, plain, pure=False)
        except Exception as error:
            if self._client.status != "closed":
                raise
            raise self._lost() from error
        asked[future.key] = (batch, tries)
        done.add(future)

    def _answer_of(self, future: Any) -> Answer | None:
        """The answer, None when the batch was lost or failed."""
        if future.status != "finished":
            return None
        try:
            answer: Answer = future.result()
        except (OSError, TimeoutError, self._lib.CancelledError):
            # It was finished, and lost with the scheduler before it was fetched.
            return None
        return answer

    def _refuse_defects(self, future: Any, tries: int) -> None:
        """Raise unless the batch was merely lost and may be asked for again."""
        if future.status == "error":
            error = future.exception()
            if isinstance(error, AssessError):
                raise error
            if not isinstance(error, self._lib.KilledWorker | WorkerClosedError):
                raise AssessError(
                    f"a Dask worker of {self._where} could not run fieldlink "
                    f"({_said(error)}); install this release of it on every "
                    "machine, and go on with the same command"
                ) from error
        if tries >= TRIES:
            raise AssessError(
                f"the Dask cluster of {self._where} lost one batch {TRIES} times; see its logs, "
                "and go on with the same command"
            )

    def _wait_for_workers(self) -> None:
        """Wait until the client, which connects again by itself, has a scheduler with workers."""
        until = time.monotonic() + CONNECT
        while (left := until - time.monotonic()) > 0.0 and self._client.status != "closed":
            if self._client.status == "running":
                try:
                    self._client.wait_for_workers(1, timeout=left)
                except TimeoutError as error:
                    raise AssessError(
                        f"the Dask scheduler of {self._where} has no workers; start some with "
                        f"dask worker {self._where}, and go on with the same command"
                    ) from error
                except OSError:
                    # It was lost meanwhile.
                    time.sleep(RETRY)
                    continue
                return
            time.sleep(RETRY)
        raise self._lost()

    def _lost(self) -> AssessError:
        return AssessError(
            f"the Dask scheduler of {self._where} was lost; what is done is kept: start the "
            "cluster, and go on with the same command"
        )

    def _close_cluster(self) -> None:
        if self._cluster is not None:
            self._cluster.close(timeout=10.0)


def _said(error: BaseException) -> str:
    """What an error of Dask says, without the objects that it names before it."""
    text = " ".join(str(error).split())
    return text.rpartition(">: ")[2] or "it ended the connection"
