"""A worker: ``python -m fieldlink.assess.workers.worker``, JSON lines in, JSON lines out.

The first line is the job. Each further line asks for a list of pieces or for a piece to be judged;
before each window a line names it, so that the process that watches knows which window ended a
worker. A worker ends with its standard input, computes on one thread, and is ended
by the kernel when a window takes more processor time than the job allows (a limit that a busy
machine does not move).
"""

from __future__ import annotations

import gc
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["main"]

PROBLEMS_SHOWN = 3
"""Problems of one file that its row names: enough to see the pattern, few enough for a cell."""

Send = Callable[[dict[str, Any]], None]


def main() -> int:
    """Serve until the standard input ends."""
    stdin, out = sys.stdin, os.fdopen(os.dup(1), "w", encoding="utf-8")
    # What a library prints must not get between the answers.
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    text = stdin.readline()
    if not text:
        return 0

    def read() -> None:
        for line in stdin:
            lines.put(line)
        # The process that asked is gone: no process would read an answer.
        os._exit(0)

    def send(message: dict[str, Any]) -> None:
        out.write(json.dumps(message) + "\n")
        out.flush()

    threading.Thread(target=read, name="requests", daemon=True).start()
    _serve(text, lines, send)
    return 0


def _serve(text: str, lines: queue.SimpleQueue[str], send: Send) -> None:
    from fieldlink.assess.job import Job, Piece

    job = Job.from_json(text)
    _bound_memory(job.judging.memory)
    sources = _warm_up()
    send({"ready": os.getpid(), "sources": sources})
    while True:
        request = json.loads(lines.get())
        if "list" in request:
            _list_pieces(job, request["list"], request["after"], send)
        else:
            _judge_piece(job, Piece.of(request["judge"]), request["skip"], send)


def _list_pieces(job: Any, place: int, after: str, send: Send) -> None:
    from fieldlink.assess.readers.base import Opening
    from fieldlink.assess.readers.registry import reader_of

    def run() -> None:
        for found in reader_of(job.places[place].kind).pieces(job, place, after):
            key = "opening" if isinstance(found, Opening) else "piece"
            send({key: found.piece.plain() if isinstance(found, Opening) else found.plain()})

    error = _error_of(run)
    send({"end": error})


def _judge_piece(job: Any, piece: Any, skip: int, send: Send) -> None:
    from fieldlink.assess.errors import PlaceAwayError
    from fieldlink.assess.readers.registry import reader_of
    from fieldlink.assess.table_row import moment_text
    from fieldlink.store import StoreAwayError

    away = False

    def run() -> None:
        nonlocal away
        try:
            judge()
        except (PlaceAwayError, StoreAwayError):
            away = True
            raise

    def judge() -> None:
        reader = reader_of(job.places[piece.place].kind)
        windows = enumerate(reader.windows(job, piece))
        while True:
            with _limited(job.judging.limit):
                numbered = next(windows, None)
            if numbered is None:
                return
            number, (loop, window) = numbered
            if number >= skip:
                start = moment_text(float(window.time[0]), dated=window.dated)
                send({"at": {"loop": loop, "start": start}})
                send({"row": _row_of(job.judging, piece.file, loop, window)})

    error = _error_of(run)
    send({"end": error, "away": away})


def _row_of(judging: Any, file: str, loop: str, window: Any) -> dict[str, Any]:
    """The row of a window, with an error or without."""
    from fieldlink.assess.table_row import error_row, judge_window, moment_text

    row: dict[str, Any] = {}
    with _limited(judging.limit):
        error = _error_of(lambda: row.update(judge_window(file, loop, window, judging)))
    if error is None:
        return row
    start = moment_text(float(window.time[0]), dated=window.dated)
    return error_row(file, loop, start, error)


def _error_of(work: Callable[[], None]) -> str | None:
    """Do the work; return what went wrong as the sentence of a row, None when nothing did."""
    from estimator import EstimatorError
    from fieldlink.errors import FieldlinkError
    from fieldlink.printable import as_printable

    try:
        work()
    except (FieldlinkError, EstimatorError) as error:
        return _sentence(as_printable(str(error), lines=True))
    except MemoryError:
        return "needs more memory than a worker may use; split the file, or store it as Parquet"
    except Exception as error:  # noqa: BLE001  (a defect is the error of its row, with its place)
        from fieldlink.daemon.reporting.defects import describe_defect

        return f"a defect of fieldlink, {describe_defect(error)}; report it with the recording"
    return None


def _sentence(message: str) -> str:
    """Several problems of a file in one cell: the first ones, and how many more there are."""
    problems = message.split("\n")
    more = len(problems) - PROBLEMS_SHOWN
    return " | ".join(problems[:PROBLEMS_SHOWN]) + (f" | and {more} more" if more > 0 else "")


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Let the kernel end this process after so many processor seconds."""
    if not hasattr(signal, "ITIMER_PROF"):
        yield
        return
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _bound_memory(limit: int) -> None:
    if sys.platform != "win32":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        if hard == resource.RLIM_INFINITY or hard > limit:
            resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def _warm_up() -> str:
    """Compile the kernels or load them, and return the hash of their sources."""
    import compiled
    import estimator

    estimator.warm_up()

    # what stays for good is not looked through again by each collection of garbage
    gc.collect()
    gc.freeze()
    return compiled.source_hash(Path(compiled.__file__).resolve().parent)


if __name__ == "__main__":
    sys.exit(main())
