"""What an engine is, and the work that every engine does with a batch."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from fieldlink.assess.run_file import Task
from fieldlink.assess.workers.watched import WatchedWorker

__all__ = ["Answer", "Batch", "Engine", "NextBatch", "judge_batch"]

Row = dict[str, Any]
Batch = Sequence[Task]
NextBatch = Callable[[], Batch]
"""Gives the next batch, an empty one when there is none left."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The rows of a batch.

    Attributes:
        rows: by piece number.
        seconds: from the start to the end of the batch in its worker.
    """

    rows: tuple[tuple[int, tuple[Row, ...]], ...]
    seconds: float


class Engine(Protocol):
    """Runs batches side by side; a context manager."""

    @property
    def workers(self) -> int:
        """Batches that are judged at a time."""
        ...

    def run(self, next_batch: NextBatch) -> Iterator[Answer]:
        """Yield the answer of every batch, in any order.

        Raises:
            AssessError: the engine was lost for good; answers given so far are good.
        """
        ...


def judge_batch(worker: WatchedWorker, batch: Batch) -> Answer:
    """Judge a batch in a worker process."""
    begun = time.perf_counter()
    rows = tuple((task.number, tuple(worker.judge(task.piece))) for task in batch)
    return Answer(rows, time.perf_counter() - begun)
