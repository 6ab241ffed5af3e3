"""A database server or a network folder that goes away in the middle costs no row."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fieldlink.assess import AssessError, Cut, Job, Piece, Place
from fieldlink.assess.places import place_of
from fieldlink.assess.workers import watched
from fieldlink.assess.workers.watched import WatchedWorker
from fieldlink.store import EventRecord, Historian, SampleRecord
from tests.seeds import in_suite
from tests.store.test_postgresql import Server, server  # noqa: F401  (the second is a fixture)


class Patient(WatchedWorker):
    """Calls back instead of waiting when its place is out of reach."""

    def __init__(self, job: Job, mend: Callable[[], None]) -> None:
        super().__init__(job)
        self._mend = mend
        self.looks = 0

    def _look_again(self, piece: Piece, message: str, give_up_at: float) -> None:
        super()._look_again(piece, message, give_up_at)
        self.looks += 1
        self._mend()


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watched, "LOOK_AGAIN", 0.0)


def store_in_historian(url: str, op: np.ndarray, pv: np.ndarray, folder: Path) -> Place:  # noqa: ARG001
    historian = Historian(url)
    historian.start(EventRecord(0, "daemon.started", "daemon", ""))
    for k, (o, p) in enumerate(zip(op.tolist(), pv.tolist(), strict=True)):
        historian.put(SampleRecord("FC101", 1000 * k, k, o, p, None, None, 0))
    historian.stop()
    return place_of(url)


def store_in_table(url: str, op: np.ndarray, pv: np.ndarray, folder: Path) -> Place:
    import psycopg

    with psycopg.connect(url) as db, db.cursor() as cursor:
        cursor.execute("CREATE TABLE hist (ts BIGINT, name TEXT, op REAL, pv REAL)")
        rows = zip(range(op.size), op.tolist(), pv.tolist(), strict=True)
        cursor.executemany("INSERT INTO hist VALUES (%s, 'FC101', %s, %s)", list(rows))
    (folder / "x.toml").write_text(
        f'[sql]\nurl = "{url}"\ntable = "hist"\ntime = "ts"\nloop = "name"\n'
    )
    return place_of(str(folder / "x.toml"))


@pytest.mark.parametrize("store", in_suite(1, [store_in_historian, store_in_table]))
def test_a_database_server_that_starts_again_costs_no_row(
    server: Server,  # noqa: F811
    tmp_path: Path,
    sticky,
    store: Callable[..., Place],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    place = store(server.url, sticky.op, sticky.pv, tmp_path)
    job = Job((place,), cut=Cut(samples=200))
    worker = Patient(job, server.start)
    try:
        (piece,) = worker.list_pieces(0)
        server.stop()
        rows = list(worker.judge(piece))
        assert [row["error"] for row in rows] == [None, None]
        assert worker.looks == 1
        server.stop()
        monkeypatch.setattr(watched, "AWAY", 0.0)
        with pytest.raises(AssessError, match="what is done is kept: go on with the same command"):
            list(worker.judge(piece))
    finally:
        worker.close()
        server.start()


def test_a_folder_that_is_unmounted_is_no_error_of_its_files(tmp_path: Path, sticky) -> None:
    folder, elsewhere = tmp_path / "nas", tmp_path / "elsewhere"
    folder.mkdir()
    lines = [f"{o!r},{p!r}" for o, p in zip(sticky.op.tolist(), sticky.pv.tolist(), strict=True)]
    for name in ("A.csv", "B.csv"):
        (folder / name).write_text("\n".join(["op,pv", *lines]))
    away = iter([lambda: None, lambda: folder.mkdir(), lambda: mount()])

    def mount() -> None:
        folder.rmdir()
        elsewhere.rename(folder)

    worker = Patient(Job((place_of(str(folder)),)), lambda: next(away)())
    try:
        first, second = worker.list_pieces(0)
        # Away, then a mount point with nothing in it, then there again.
        folder.rename(elsewhere)
        (row,) = worker.judge(first)
        assert row["error"] is None
        assert worker.looks == 3
        # A file that is deleted alone costs its row.
        (folder / "B.csv").unlink()
        (row,) = worker.judge(second)
        assert "No such file" in row["error"]
    finally:
        worker.close()
