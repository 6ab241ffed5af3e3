"""What is measured in minutes: jobs on APScheduler, in UTC, one at a time each, never piled up.

APScheduler compares wall-clock times: after a step back of the clock by an hour its jobs would wait
an hour too long. So the part that notices a step reports it, and every job moves with the clock.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime, timedelta
from typing import Any

from apscheduler.events import EVENT_JOB_ERROR
from apscheduler.schedulers.asyncio import AsyncIOScheduler

__all__ = ["Schedule"]

_SHORTEST = 0.02
"""Seconds: no job is postponed by less."""


class Schedule:
    """Periodic jobs in the running event loop.

    An error that a job raises is set on ``failed``, a future to await beside everything else.
    """

    def __init__(self) -> None:
        self.failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._scheduler: Any = AsyncIOScheduler(
            timezone=UTC,
            job_defaults={"coalesce": True, "max_instances": 1, "misfire_grace_time": None},
        )
        self._scheduler.add_listener(self._on_error, EVENT_JOB_ERROR)

    def every(self, seconds: float, name: str, job: Callable[[], Awaitable[None]]) -> None:
        """Run ``job`` every so many seconds, the first time after the first interval.

        A job of the same name is replaced.
        """
        self._scheduler.add_job(
            job, "interval", seconds=max(seconds, _SHORTEST), id=name, replace_existing=True
        )

    def postpone(self, name: str, seconds: float) -> None:
        """Let the next run of a job be ``seconds`` from now; the interval counts from there."""
        due = datetime.now(UTC) + timedelta(seconds=max(seconds, _SHORTEST))
        if self._scheduler.get_job(name) is not None:
            self._scheduler.modify_job(name, next_run_time=due)

    def remove(self, name: str) -> None:
        """Stop running a job; one that does not exist is not an error."""
        if self._scheduler.get_job(name) is not None:
            self._scheduler.remove_job(name)

    def clock_stepped(self, seconds: float) -> None:
        """Move every job along with a wall clock that has stepped by ``seconds``."""
        latest = datetime.now(UTC)
        for job in self._scheduler.get_jobs():
            due = job.next_run_time
            if due is None:
                continue
            moved = due + timedelta(seconds=seconds)
            # After a step forward, a job that ran meanwhile is ahead of the clock already.
            if seconds < 0.0 or moved - latest <= job.trigger.interval:
                job.modify(next_run_time=moved)

    def start(self) -> None:
        """Begin."""
        self._scheduler.start()

    def stop(self) -> None:
        """End; jobs that run are cancelled."""
        self.failed.cancel()
        if self._scheduler.running:
            self._scheduler.shutdown(wait=False)

    def pause(self) -> None:
        """Begin no more jobs; those that run go on."""
        if self._scheduler.running:
            self._scheduler.pause()

    def _on_error(self, event: Any) -> None:
        if not self.failed.done():
            self.failed.set_exception(event.exception)
