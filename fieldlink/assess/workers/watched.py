"""A worker process as seen from outside: asked for rows, watched, and replaced when it dies.

What kills a worker costs its own row alone: the worker has named its window, and a new worker goes
on with the next one. Most workers are killed from outside, so a window is tried again;
one that uses up its processor time would do so again and is tried once.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.table_row import error_row
from fieldlink.assess.workers.failed_rows import failed_row, placed, without_place

__all__ = ["TRIES", "WatchedWorker", "WorkerClosedError"]

TRIES = 3
"""Deaths by a fault of the process itself, over one window, before it is given up."""

KILLS = 10
"""Deaths by a signal that others send, over one window, before it is given up: an operator or a
service manager hits a window once, the kernel that is out of memory hits it every time."""

_SENT = frozenset(
    -getattr(signal, name)
    for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
    if hasattr(signal, name)
)
"""Exit statuses of processes that were ended from outside."""

STARTS = 20
"""Workers in a row that die before they are ready: then it is not the data."""

AWAY = 60.0
"""Seconds for which a place out of reach is tried again: as long as a database server needs to
start again, or a network folder to be mounted."""

LOOK_AGAIN = 1.0
"""Seconds between two tries."""

PROCESS = (sys.executable, "-m", "fieldlink.assess.workers.worker")
"""What a worker's process runs."""

_ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
) | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
"""Every core has a worker; threads of their own would only take it from each other. Arrow's own
allocator would reserve half of the memory that a worker may use."""

Row = dict[str, Any]
Message = dict[str, Any]


class WorkerClosedError(Exception):
    """The worker was closed while it was asked: the run is being stopped."""


class _DiedError(Exception):
    """The worker's process ended over a request; ``status`` as `subprocess` gives it."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class WatchedWorker:
    """One worker process; requests and `close` come from one thread, `interrupt` from any.

    Args:
        job: what is assessed.
    """

    def __init__(self, job: Job) -> None:
        self._job = job
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self._sources = ""
        self.deaths = 0

    @property
    def pid(self) -> int | None:
        """The process id of the worker that runs now."""
        return None if self._process is None else self._process.pid

    def start(self) -> str:
        """Start the process and return the hash of its numeric sources.

        Raises:
            AssessError: it cannot be started.
        """
        if self._process is None:
            self._start()
        return self._sources

    def interrupt(self) -> None:
        """End the process under a request, which then raises `WorkerClosedError`."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()

    def close(self) -> None:
        """End the process."""
        self._closed = True
        process, self._process = self._process, None
        if process is not None:
            _end(process)

    def list_pieces(self, place: int) -> Iterator[Piece]:
        """Yield the pieces of a place.

        Raises:
            AssessError: it cannot be opened.
        """
        shown = self._job.places[place].shown
        after = ""
        while True:
            opening: Piece | None = None
            listed = False
            try:
                for message in self._ask({"list": place, "after": after}):
                    if "opening" in message:
                        opening, listed = Piece.of(message["opening"]), False
                    elif "piece" in message:
                        listed = True
                        yield Piece.of(message["piece"])
                    elif message["end"] is not None:
                        raise AssessError(placed(shown, message["end"]))
                return
            except _DiedError as death:
                if opening is None:
                    raise AssessError(
                        f"{shown}: reading what is in it {_fate(death.status)}"
                    ) from death
                if not listed:
                    # Judging it will say so in its row.
                    yield opening
                after = opening.path

    def judge(self, piece: Piece) -> Iterator[Row]:
        """Yield the rows of a piece, in order, whatever happens to the process.

        Raises:
            AssessError: no worker can be started, or the place stays out of reach.
            WorkerClosedError: `interrupt` was called.
        """
        deaths: Counter[int] = Counter()
        done = 0
        give_up_at: float | None = None
        while True:
            at: dict[str, str] | None = None
            try:
                for message in self._ask({"judge": piece.plain(), "skip": done}):
                    if "at" in message:
                        at = message["at"]
                    elif "row" in message:
                        yield message["row"]
                        done, at, give_up_at = done + 1, None, None
                    elif message["end"] is None:
                        return
                    elif not message["away"]:
                        yield failed_row(piece, without_place(message["end"], piece))
                        return
                    else:
                        give_up_at = give_up_at or time.monotonic() + AWAY
                        self._look_again(piece, message["end"], give_up_at)
            except _DiedError as death:
                deaths[done] += 1
                if deaths[done] < _tries(death.status):
                    continue
                if at is None:
                    yield failed_row(piece, f"reading it {_fate(death.status)}")
                    return
                message_text = f"judging it {_fate(death.status)}"
                yield error_row(piece.file, at["loop"], at["start"], message_text)
                done += 1

    def _look_again(self, piece: Piece, message: str, give_up_at: float) -> None:
        """Wait for a place that is out of reach; raise when it has been for too long."""
        if time.monotonic() >= give_up_at:
            shown = self._job.places[piece.place].shown
            raise AssessError(
                f"{placed(shown, message)}; it was tried for {AWAY:g} s, and what is done is kept: "
                "go on with the same command"
            )
        time.sleep(LOOK_AGAIN)
        if self._closed:
            raise WorkerClosedError

    def _ask(self, request: Message) -> Iterator[Message]:
        """Send a request and yield the answers; the last one has the key ``end``."""
        process = self._process or self._start()
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        except OSError:
            raise self._died() from None
        while True:
            message = self._next(process)
            if message is None:
                raise self._died()
            yield message
            if "end" in message:
                return

    def _next(self, process: subprocess.Popen[str]) -> Message | None:
        """The next answer, None when the process has ended; an unfinished line does not count."""
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line.endswith("\n"):
            return None
        message: Message = json.loads(line)
        return message

    def _died(self) -> _DiedError:
        process, self._process = self._process, None
        status = 0 if process is None else _end(process)
        if self._closed or process is None:
            raise WorkerClosedError
        self.deaths += 1
        return _DiedError(status)

    def _start(self) -> subprocess.Popen[str]:
        for _ in range(STARTS):
            process = subprocess.Popen(
                PROCESS,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                env=os.environ | _ENVIRONMENT,
                # A terminal's Ctrl-C is for the run as a whole.
                start_new_session=True,
            )
            self._process = process
            if self._closed:
                raise self._died()
            ready = self._greet(process)
            if ready is not None:
                self._refuse_other_release(ready)
                return process
            status = self._died().status
        raise AssessError(
            f"no worker can be started ({_fate(status)}); see what it says above, and try "
            "fieldlink warm-up"
        )

    def _greet(self, process: subprocess.Popen[str]) -> Message | None:
        assert process.stdin is not None
        try:
            process.stdin.write(self._job.to_json() + "\n")
            process.stdin.flush()
        except OSError:
            return None
        return self._next(process)

    def _refuse_other_release(self, ready: Message) -> None:
        self._sources = str(ready["sources"])
        if self._job.sources not in ("", self._sources):
            self.close()
            raise AssessError(
                "a worker has another release of fieldlink than this one; install the same on "
                "every machine, or its rows would not be comparable"
            )


def _end(process: subprocess.Popen[str]) -> int:
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            try:
                stream.close()
            except OSError:
                # What was not written cannot be flushed into a process that is gone.
                continue
    return process.wait()


def _tries(status: int) -> int:
    """How many deaths of this kind a window is allowed."""
    if _ran_out_of_time(status):
        return 1
    return KILLS if status in _SENT else TRIES


def _ran_out_of_time(status: int) -> bool:
    return hasattr(signal, "SIGPROF") and status == -signal.SIGPROF


def _fate(status: int) -> str:
    """What ended a worker, for a sentence."""
    if _ran_out_of_time(status):
        return "took more processor time than a window may; shorten the windows with --samples"
    name = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    return (
        f"ended the worker's process ({name}) every time; look for a damaged file, or for a limit "
        "of memory"
    )
