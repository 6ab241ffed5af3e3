"""One run from the places to the table: plan, judge, rank, write; continued where it was stopped.

    outcome = assess(job, Path("fleet"), EngineChoice("local", workers=2), progress)

While it runs, the folder holds `run.sqlite`; when it is finished, ``loops.parquet``, ``loops.csv``,
``report.html`` and ``run.json``, which says what was asked and how it ended.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

from fieldlink.assess.engines.base import Batch, Engine
from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import RECORD, RUN_FILE, Job, Piece
from fieldlink.assess.run_file import Counts, RunFile
from fieldlink.assess.workers.watched import WatchedWorker
from fieldlink.unfinished_file import write_whole

__all__ = ["EngineChoice", "Outcome", "Progress", "assess"]

OUTPUTS = ("loops.parquet", "loops.csv", "notes.csv", "report.html")

BATCH_SECONDS = 3.0
"""Aimed at for a batch: its overhead (milliseconds here, some tens of them on a cluster) is below
2 %, and a killed run repeats no more than this for each worker."""

LARGEST_BATCH = 256
"""Pieces of a batch; they may be quick to read and then slow to judge."""


class Progress(Protocol):
    """Receives the progress of a run."""

    def planned(self, pieces: int) -> None:
        """Take note that ``pieces`` were found up to now."""
        ...

    def judged(self, counts: Counts, rows_per_second: float) -> None:
        """Take note that another batch is stored; the speed is that since this process began."""
        ...


@dataclass(frozen=True, slots=True)
class EngineChoice:
    """Which engine: ``local`` or ``dask``, its workers, and the address of a scheduler."""

    kind: str = "local"
    workers: int = 1
    scheduler: str | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    Attributes:
        loops, rows, errors: counts of the table.
        outside: files or parts of loops with nothing between ``since`` and ``until``.
        seconds: this process took; judged: rows that it added.
        already: whether the run had been finished before.
    """

    loops: int
    rows: int
    errors: int
    seconds: float
    judged: int
    outside: int = 0
    already: bool = False


def assess(job: Job, out: Path, choice: EngineChoice, progress: Progress) -> Outcome:
    """Do the job, or what is left of it.

    Args:
        job: what is assessed; its ``sources`` are filled in here.
        out: the folder; made when it is not there.
        choice: the engine.
        progress: called after every batch.

    Raises:
        AssessError: the folder holds another run, or the run cannot begin or go on.
        KeyboardInterrupt: what is done is kept.
    """
    begun = time.perf_counter()
    _check_places(out, job)
    _make_folder(out)
    record = out / RECORD
    if os.path.isfile(record) and not os.path.exists(out / RUN_FILE):
        return _finished_before(record, job, out)
    scout = WatchedWorker(job)
    try:
        run_file = RunFile(out / RUN_FILE)
        try:
            # A run that was not planned to its end has nothing that is worth keeping; nor has one
            # that read nothing, as with the wrong address of a scheduler: its options may change.
            planned = run_file.meta("planned")
            stored = run_file.meta("options") if planned else None
            has_read = planned and run_file.counts().done > 0
            if has_read:
                _agree(stored, job, out)
            job = replace(job, sources=scout.start())
            if has_read:
                _agree(stored, job, out)
            planned = planned and stored == json.loads(json.dumps(job.options()))
            if not planned:
                run_file.set_meta("options", job.options())
                run_file.plan(_told(_all_pieces(scout, job), progress))
            before = run_file.counts()
            places = ", ".join(place.shown for place in job.places)
            if before.pieces == 0:
                run_file.set_meta("planned", False)
                remedy = "name files, a folder or a store"
                if all(place.kind == "sql" for place in job.places):
                    remedy = "the table has no rows of OP and PV: check sql.table"
                raise AssessError(f"{places}: nothing to assess; {remedy}")
            _judge(job, run_file, choice, progress, before, scout)
            if run_file.counts().rows == 0:
                run_file.set_meta("planned", False)
                raise AssessError(f"{places}: no samples between --since and --until; check them")
            outcome = _finish(job, run_file, out, begun, before)
        finally:
            run_file.close()
    finally:
        scout.close()
    (out / RUN_FILE).unlink()
    return outcome


def _check_places(out: Path, job: Job) -> None:
    """Refuse what would be read twice, and a folder of tables that is itself what is read."""
    files = [place for place in job.places if place.kind == "files"]
    known = {Path(os.path.realpath(place.where)): place for place in files}
    for place in job.places:
        if place.kind == "files":
            where = Path(os.path.realpath(place.where))
            above = [known[path] for path in where.parents if path in known]
            twice = [*above, *([known[where]] if known[where] is not place else [])]
        else:
            twice = [one for one in job.places if one.where == place.where and one is not place]
        if twice:
            raise AssessError(
                f"{place.shown} is given twice, also by {twice[0].shown}; its windows would count "
                "twice: name it once"
            )
    # Folders of runs are left out where recordings are looked for.
    if read := known.get(Path(os.path.realpath(out))):
        raise AssessError(
            f"{read.shown} is what is read; name a folder of its own with --out, which may be "
            "inside it"
        )


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AssessError(
            f"the folder {out} cannot be made ({error.strerror}); name another one with --out"
        ) from error
    marks = [name for name in (RUN_FILE, RECORD) if os.path.exists(out / name)]
    others = [name for name in OUTPUTS if os.path.exists(out / name)]
    if others and not marks:
        raise AssessError(
            f"the folder {out} holds {others[0]} of something else; name another one with --out"
        )


def _agree(stored: dict[str, Any] | None, job: Job, out: Path) -> None:
    """Refuse to go on with a run that was begun with other options."""
    if stored is None:
        return
    for key, value in json.loads(json.dumps(job.options())).items():
        # Until a worker runs, its release is not known.
        if stored.get(key) == value or (key == "sources" and not value):
            continue
        if key == "sources":
            change = "another release of fieldlink"
        elif isinstance(value, dict):
            before = stored.get(key) or {}
            names = [name for name, one in value.items() if before.get(name) != one]
            change = f"another value of {names[0]} ({_shown(names[0], before.get(names[0]))})"
        else:
            change = f"other {key} ({_plain(stored.get(key))})"
        raise AssessError(
            f"the folder {out} holds a run with {change}; name another folder with --out, or "
            "remove this one"
        )


def _shown(name: str, value: Any) -> str:
    """An option as people write it: moments are kept as seconds."""
    from fieldlink.assess.table_row import moment_text

    is_moment = name in ("since", "until") and value is not None
    return moment_text(value, dated=True) if is_moment else "none" if value is None else str(value)


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _finished_before(record: Path, job: Job, out: Path) -> Outcome:
    try:
        stored = json.loads(record.read_text(encoding="utf-8"))
        counts = (stored["loops"], stored["rows"], stored["errors"])
        options = dict(stored["options"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise AssessError(
            f"{record} is not the record of a run; name another folder with --out"
        ) from error
    _agree(options, job, out)
    return Outcome(*counts, seconds=0.0, judged=0, already=True)


def _all_pieces(scout: WatchedWorker, job: Job) -> Iterator[Piece]:
    return chain.from_iterable(scout.list_pieces(place) for place in range(len(job.places)))


def _told(pieces: Iterator[Piece], progress: Progress) -> Iterator[Piece]:
    for number, piece in enumerate(pieces, start=1):
        yield piece
        if number % 100 == 0:
            progress.planned(number)


def _judge(
    job: Job,
    run_file: RunFile,
    choice: EngineChoice,
    progress: Progress,
    before: Counts,
    scout: WatchedWorker,
) -> None:
    if before.done == before.pieces:
        return
    with _engine(job, choice, scout) as engine:
        batches = _Batches(run_file, engine.workers, before.pieces - before.done)
        begun = time.perf_counter()
        counts = before
        for answer in engine.run(batches.next):
            run_file.store(answer.rows)
            batches.learn(len(answer.rows), answer.seconds)
            rows = [row for _, own in answer.rows for row in own]
            counts = Counts(
                counts.pieces,
                counts.done + len(answer.rows),
                counts.rows + len(rows),
                counts.errors + sum(row["error"] is not None for row in rows),
            )
            elapsed = time.perf_counter() - begun
            progress.judged(counts, (counts.rows - before.rows) / elapsed)


def _engine(job: Job, choice: EngineChoice, scout: WatchedWorker) -> Any:
    """The chosen engine, as a context manager."""
    if choice.kind == "dask":
        from fieldlink.assess.engines.dask_cluster import DaskEngine

        engine: Engine = DaskEngine(job, choice.scheduler, choice.workers, scout)
    else:
        from fieldlink.assess.engines.local import LocalEngine

        engine = LocalEngine(job, choice.workers, scout)
    return engine


class _Batches:
    """Takes batches from the run file, of about `BATCH_SECONDS` as far as is known."""

    def __init__(self, run_file: RunFile, workers: int, pieces: int) -> None:
        self._run_file = run_file
        # Every worker gets a part of a small run.
        self._largest = max(1, min(LARGEST_BATCH, pieces // (4 * workers)))
        self._size = 1
        self._last = 0

    def next(self) -> Batch:
        """The next batch, empty when all pieces are asked for."""
        tasks = self._run_file.tasks(self._size, self._last)
        if tasks:
            self._last = tasks[-1].number
        return tasks

    def learn(self, pieces: int, seconds: float) -> None:
        """Adapt the size to how long a batch took; at most four times the one before."""
        aimed = round(BATCH_SECONDS * pieces / max(seconds, 1e-3))
        self._size = max(1, min(aimed, 4 * self._size, self._largest))


def _finish(job: Job, run_file: RunFile, out: Path, begun: float, before: Counts) -> Outcome:
    from fieldlink.assess.page import write_page
    from fieldlink.assess.table_files import write_tables

    run_file.index_loops()
    run_file.rank()
    counts = run_file.counts()
    loops = sum(run_file.classes().values())
    write_tables(run_file, out)
    write_page(run_file, job, counts, out / "report.html")
    outcome = Outcome(
        loops,
        counts.rows,
        counts.errors,
        time.perf_counter() - begun,
        counts.rows - before.rows,
        run_file.pieces_without_rows(),
    )
    record = {"options": job.options(), **asdict(outcome)}
    try:
        write_whole(out / RECORD, f"{json.dumps(record, indent=2)}\n".encode())
    except OSError as error:
        raise AssessError(
            f"{out / RECORD} cannot be written ({error.strerror}); check the folder and the free "
            "space, and go on with the same command"
        ) from error
    return outcome
