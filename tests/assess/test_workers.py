"""Workers that die, windows that kill them, and both engines over the same pieces."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fieldlink.assess import AssessError, Job, Judging, Piece, assessment
from fieldlink.assess.assessment import EngineChoice, assess
from fieldlink.assess.places import place_of
from fieldlink.assess.run_file import Counts
from fieldlink.assess.workers import watched
from fieldlink.assess.workers.watched import WatchedWorker
from tests.assess.cut_line import CutLine


class Deadly(WatchedWorker):
    """Its process gets signals over the windows of some loops, one each time."""

    def __init__(self, job: Job, signals: dict[str, list[int]]) -> None:
        super().__init__(job)
        self._signals = signals
        self._killed = False

    def _next(self, process: Any) -> Any:
        message = super()._next(process)
        if self._killed:
            # What it had written before it was killed is not let through.
            while message is not None:
                message = super()._next(process)
            self._killed = False
        elif message is not None and "at" in message:
            left = self._signals.get(message["at"]["loop"], [])
            if left:
                os.kill(process.pid, left.pop())
                self._killed = True
        return message


class Quiet:
    """Progress that is not shown."""

    def planned(self, pieces: int) -> None: ...
    def judged(self, counts: Counts, rows_per_second: float) -> None: ...


class Watching(Quiet):
    """Notes the memory of this process and of its workers after every batch."""

    def __init__(self) -> None:
        self.rows: list[int] = []
        self.megabytes: list[float] = []

    def judged(self, counts: Counts, rows_per_second: float) -> None:  # noqa: ARG002
        everyone = [psutil.Process(), *psutil.Process().children(recursive=True)]
        self.rows.append(counts.rows)
        self.megabytes.append(sum(one.memory_info().rss for one in everyone) / 1e6)


def two_loops(folder: Path, sticky: Any, healthy: Any) -> Path:
    lines = ["loop,op,pv"]
    for name, loop in (("A", sticky), ("B", healthy), ("C", healthy)):
        pairs = zip(loop.op.tolist(), loop.pv.tolist(), strict=True)
        lines += [f"{name},{o!r},{p!r}" for o, p in pairs]
    (folder / "loops.csv").write_text("\n".join(lines))
    return folder / "loops.csv"


@pytest.mark.thorough
def test_a_window_that_kills_its_worker_costs_one_row_and_one_killed_by_chance_none(
    tmp_path: Path, sticky, healthy, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each death costs a start: two of them show what three do.
    tries = 2
    monkeypatch.setattr(watched, "TRIES", tries)
    file = two_loops(tmp_path, sticky, healthy)
    job = Job((place_of(str(file)),))
    piece = Piece(0, str(file), str(file))
    worker = Deadly(job, {"A": [signal.SIGKILL], "B": tries * [signal.SIGSEGV]})
    try:
        rows = list(worker.judge(piece))
    finally:
        worker.close()
    assert worker.deaths == 1 + tries
    assert [row["loop"] for row in rows] == ["A", "B", "C"]
    assert rows[0]["verdict"] == "stiction"
    assert rows[1]["verdict"] is None
    assert "SIGSEGV" in rows[1]["error"]
    assert rows[2]["error"] is None


def test_a_window_is_ended_by_its_processor_time_not_by_the_clock(tmp_path: Path, sticky) -> None:
    file = two_loops(tmp_path, sticky, sticky)
    job = Job((place_of(str(file)),), judging=Judging(limit=0.005))
    worker = WatchedWorker(job)
    try:
        row = next(worker.judge(Piece(0, str(file), str(file))))
    finally:
        worker.close()
    assert "more processor time than a window may" in row["error"]


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_number_of_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loops, samples = 3000, 60
    names = np.repeat([f"L{number:04}" for number in range(loops)], samples)
    # OP that stands still is refused at once: what is left is reading, storing and ranking.
    pv = np.random.default_rng(1).normal(size=names.size)
    columns = {"loop": names, "op": np.full(names.size, 40.0), "pv": pv}
    pq.write_table(pa.table(columns), tmp_path / "fleet.parquet", row_group_size=40 * samples)
    monkeypatch.setattr(assessment, "BATCH_SECONDS", 0.3)
    watching = Watching()
    job = Job((place_of(str(tmp_path)),))
    outcome = assess(job, tmp_path / "out", EngineChoice("local", workers=1), watching)
    assert (outcome.loops, outcome.rows, outcome.errors) == (loops, loops, 0)
    early = next(n for n, rows in enumerate(watching.rows) if rows >= loops // 5)
    assert watching.rows[early] <= loops // 2
    # A row takes two kilobytes as an object: were all rows kept, that alone would be 4.8 MB.
    assert max(watching.megabytes[early:]) - watching.megabytes[early] < 3.6


@pytest.mark.thorough
def test_dask_gives_the_rows_of_the_local_pool(
    judged: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    started: list[list[str]] = []
    start = subprocess.Popen.__init__

    def note_start(*given: Any, **options: Any) -> None:
        started.append(given[1])
        start(*given, **options)

    monkeypatch.setattr(subprocess.Popen, "__init__", note_start)
    job = Job((place_of(str(judged)),))
    outcome = assess(job, tmp_path / "dask", EngineChoice("dask", workers=1), Quiet())
    assert (outcome.rows, outcome.errors) == (4, 1)
    # The process that listed the files judges them, too.
    assert sum("fieldlink.assess.workers.worker" in command for command in started) == 1
    texts = []
    for folder in (judged / "out", tmp_path / "dask"):
        lines = (folder / "loops.csv").read_text().splitlines()
        texts.append([[cell for n, cell in enumerate(line.split(",")) if n < 11] for line in lines])
    assert texts[0] == texts[1]


def test_a_scheduler_that_is_lost_at_any_moment_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    distributed = pytest.importorskip("distributed")
    from fieldlink.assess.engines import dask_cluster

    monkeypatch.setattr(dask_cluster, "CONNECT", 0.3)
    job = Job((place_of(str(tmp_path)),))

    def run(port: int) -> None:
        with dask_cluster.DaskEngine(
            job, f"tcp://127.0.0.1:{port}", 1, WatchedWorker(job)
        ) as engine:
            assert list(engine.run(lambda: ())) == []

    with distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None
    ) as cluster:
        server = int(cluster.scheduler_address.rpartition(":")[2])
        with CutLine(server) as whole:
            run(whole.port)
        for limit in (150, 700):
            with (
                CutLine(server, limit) as cut,
                pytest.raises(AssessError, match=r"no Dask scheduler answers|was lost") as said,
            ):
                run(cut.port)
            assert "<" not in str(said.value)
        # With the last bytes of all: the work is done, and nothing is lost.
        with CutLine(server, whole.passed - 10) as cut:
            run(cut.port)
    assert "Traceback" not in capfd.readouterr().err
