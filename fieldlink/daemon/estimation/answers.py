"""What comes back from a worker: a value, or the outcome of a request without one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from fieldlink.daemon.estimation.estimating import EstimateOutcome

__all__ = ["Answer", "InlineWorker", "Worker"]

T = TypeVar("T")
A = TypeVar("A")


@dataclass(frozen=True, slots=True)
class Answer(Generic[T]):
    """A worker's answer.

    Attributes:
        outcome: `EstimateOutcome.ESTIMATED` with a value, another one without.
        message: the cause when there is no value, else empty.
        value: what the work gave.
    """

    outcome: EstimateOutcome
    message: str = ""
    value: T | None = None


class Worker(Protocol):
    """What does the work: a pool of processes, or the caller's own thread."""

    async def call(self, work: Callable[[A], T], task: A) -> Answer[T]:
        """Have something done; never raises for what the task or a worker does."""
        ...


class InlineWorker:
    """Works in the caller's thread: deterministic, for lockstep runs."""

    async def call(self, work: Callable[[A], T], task: A) -> Answer[T]:
        """Do it."""
        return Answer(EstimateOutcome.ESTIMATED, value=work(task))
