"""Places as plants have them: links, folders that go away, tables with holes, clocks set back."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fieldlink.assess import AssessError, Columns, Cut, Job, Piece, Place
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.places import place_of
from fieldlink.assess.readers import files
from fieldlink.assess.readers.base import Opening
from fieldlink.assess.readers.files import FileReader
from fieldlink.assess.readers.registry import reader_of
from fieldlink.assess.run_file import RunFile
from fieldlink.assess.table_row import error_row
from fieldlink.assess.workers.failed_rows import without_place
from fieldlink.errors import FieldlinkError
from fieldlink.site import SiteError, load_site
from fieldlink.site.errors import RecordingError
from tests.assess.conftest import Recorded, write_csv
from tests.assess.test_readers import (
    BEGIN,
    as_csv,
    as_historian,
    as_moments,
    as_parquet,
    as_values,
    windows,
)
from tests.cli.typed import run_typed


def listed(job: Job) -> list[str]:
    found = FileReader().pieces(job, 0, "")
    return [piece.file for piece in found if isinstance(piece, Piece)]


def test_links_are_followed_and_each_folder_is_read_once(tmp_path: Path, sticky) -> None:
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    write_csv(site / "a" / "FC1.csv", sticky)
    write_csv(elsewhere / "FC2.csv", sticky)
    (site / "a" / "up").symlink_to(site)
    (site / "b").symlink_to(elsewhere)
    (site / "c").symlink_to(elsewhere)
    (site / "gone.csv").symlink_to(tmp_path / "nothing.csv")
    os.mkfifo(site / "pipe.csv")
    # What lies beside a historian is none.
    with sqlite3.connect(site / "mqtt_spool.sqlite") as spool:
        spool.execute("CREATE TABLE messages (id INTEGER)")
    spool.close()
    job = Job((place_of(str(site)),))
    names = ("gone.csv", "pipe.csv", "a/FC1.csv", "b/FC2.csv")
    assert listed(job) == [str(site / name) for name in names]
    with pytest.raises(ReadingError, match="is a pipe or a device"):
        list(FileReader().windows(job, Piece(0, "pipe.csv", str(site / "pipe.csv"))))


def test_a_name_that_is_not_utf8_costs_nothing(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/W\xe4rme"))
    for name in (b"R\xfccklauf.csv", b"ok.csv"):
        write_csv(folder / os.fsdecode(name), Recorded(np.zeros(60), np.zeros(60)))
    (folder / os.fsdecode(b"\xe4.csv")).write_text("op,pv\n1.0,off\n")
    (folder / os.fsdecode(b"\xe4.parquet")).write_bytes(b"PAR1")
    done = run_typed(tmp_path, "assess", folder.name, "--out", "out", "--workers", 1)
    assert done.returncode == 1, done.stderr
    rows = {row["file"]: row for row in pq.read_table(tmp_path / "out/loops.parquet").to_pylist()}
    names = (r"R\xfccklauf.csv", "ok.csv", r"\xe4.csv", r"\xe4.parquet")
    assert set(rows) == {rf"W\xe4rme/{name}" for name in names}
    assert rows[r"W\xe4rme/R\xfccklauf.csv"]["loop"] == r"R\xfccklauf"
    assert rows[r"W\xe4rme/\xe4.csv"]["error"].startswith("line 2: pv: 'off' is not")
    assert "rme" not in rows[r"W\xe4rme/\xe4.parquet"]["error"]


def test_a_message_loses_the_whole_path_of_its_file() -> None:
    # one name is the end of the other, and a set of the two has another order for other names
    for number in range(20):
        piece = Piece(0, f"rec/{number}.csv", f"/plant/rec/{number}.csv")
        assert without_place(f"{piece.path}: is empty", piece) == "is empty"


def test_a_folder_that_goes_away_while_it_is_listed_costs_one_row(
    tmp_path: Path, sticky, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b", "c"):
        write_csv(tmp_path / name / "FC1.csv", sticky)
    kind = files._kind

    def remove(path: str) -> object:
        shutil.rmtree(tmp_path / "b", ignore_errors=True)
        return kind(path)

    monkeypatch.setattr(files, "_kind", remove)
    job = Job((place_of(str(tmp_path)),))
    assert listed(job) == [str(tmp_path / name) for name in ("a/FC1.csv", "b", "c/FC1.csv")]
    with pytest.raises(FieldlinkError, match=r"^the folder cannot be .*; check|No such file"):
        list(FileReader().windows(job, Piece(0, "b", str(tmp_path / "b"))))
    opened = [one for one in FileReader().pieces(job, 0, "") if isinstance(one, Opening)]
    assert len(opened) == 2


def test_a_table_with_holes_texts_and_doubles_gives_what_is_in_it(tmp_path: Path, sticky) -> None:
    place = as_moments(tmp_path, sticky.op, sticky.pv)
    with sqlite3.connect(tmp_path / "plant.db") as db:
        db.execute("INSERT INTO hist VALUES (NULL, 'FC101', 1.0, 1.0)")
        db.execute("INSERT INTO hist SELECT * FROM hist WHERE ts LIKE '%00:00:2_.%'")
        db.execute("UPDATE hist SET value = 'Bad' WHERE ts LIKE '%00:01:00.%'")
        db.execute("UPDATE hist SET value = NULL WHERE ts LIKE '%00:01:01.%'")
    db.close()
    ((_, found),) = windows(place, Cut(samples=1000))
    assert len(found) == 400
    np.testing.assert_array_equal(found.op, sticky.op)
    expected = sticky.pv.copy()
    expected[60:62] = np.nan
    np.testing.assert_array_equal(found.pv, expected)


@pytest.mark.parametrize("zone", ["+05:30", "Z"])
def test_moments_that_are_text_may_have_a_time_zone(tmp_path: Path, sticky, zone: str) -> None:
    hours = 5.5 if zone == "+05:30" else 0.0
    stamps = np.datetime64(BEGIN, "s") + np.arange(400) + np.timedelta64(int(3600 * hours), "s")
    with sqlite3.connect(tmp_path / "plant.db") as db:
        db.execute("CREATE TABLE hist (ts TEXT, out REAL, value REAL)")
        rows = zip([f"{t}{zone}" for t in stamps], sticky.op, sticky.pv, strict=True)
        db.executemany("INSERT INTO hist VALUES (?, ?, ?)", rows)
    text = '[sql]\nurl = "sqlite:///plant.db"\ntable = "hist"\ntime = "ts"\nop = "out"\n'
    (tmp_path / "x.toml").write_text(f'{text}pv = "value"\n')
    place = place_of(str(tmp_path / "x.toml"))
    ((_, found),) = windows(place, Cut(since=BEGIN + 100.0, until=BEGIN + 200.0))
    assert found.time[0] == BEGIN + 100.0
    np.testing.assert_array_equal(found.op, sticky.op[100:200])
    with sqlite3.connect(tmp_path / "plant.db") as db:
        db.execute("INSERT INTO hist VALUES ('2026-07-01T00:00:00-08:00', 1, 1)")
    db.close()
    with pytest.raises(ReadingError, match="text of two time zones"):
        windows(place, Cut(since=BEGIN + 100.0))


def test_the_hour_that_autumn_repeats_is_two_hours(tmp_path: Path, sticky) -> None:
    # Local time, 30 s a sample: an hour after 01:00 it is 01:00 again.
    minutes = np.concatenate([np.arange(0, 120, 0.5), np.arange(60, 140, 0.5)])
    stamps = np.datetime64("2026-10-25T00:00", "s") + (60 * minutes).astype(int)
    signals = (sticky.op.tolist(), sticky.pv.tolist())
    lines = [f"{t},{o!r},{p!r}" for t, o, p in zip(stamps, *signals, strict=True)]
    (tmp_path / "x.csv").write_text("\n".join(["time,op,pv", *lines]))
    ((_, found),) = windows(place_of(str(tmp_path / "x.csv")), Cut())
    assert found.period == 30.0
    np.testing.assert_array_equal(found.op, sticky.op[:400])
    np.testing.assert_array_equal(found.pv, sticky.pv[:400])


def test_a_parquet_file_of_two_exports_that_overlap_has_each_moment_once(
    tmp_path: Path, sticky
) -> None:
    rows = np.concatenate([np.arange(0, 250), np.arange(150, 400)])
    times = pa.array(1000 * (BEGIN + rows), pa.timestamp("ms", "UTC"))
    columns = {"time": times, "op": sticky.op[rows], "pv": sticky.pv[rows]}
    pq.write_table(pa.table(columns), tmp_path / "x.parquet")
    ((_, found),) = windows(place_of(str(tmp_path / "x.parquet")), Cut())
    np.testing.assert_array_equal(found.op, sticky.op)


@pytest.mark.parametrize("counts", [1, 1000, 10**9])
def test_a_parquet_file_of_numbers_has_loops_and_moments(
    tmp_path: Path, sticky, counts: int
) -> None:
    times = counts * (BEGIN + np.arange(400, dtype=np.int64))
    loops = np.repeat([101, 102], 200)
    table = pa.table({"time": times, "loop": loops, "op": sticky.op, "pv": sticky.pv})
    pq.write_table(table, tmp_path / "x.parquet")
    place = place_of(str(tmp_path))
    found = windows(place, Cut())
    assert [(name, len(window), window.time[0]) for name, window in found] == [
        ("101", 200, BEGIN),
        ("102", 200, BEGIN + 200.0),
    ]
    assert all(window.dated and window.period == 1.0 for _, window in found)
    first, second = windows(place, Cut(since=BEGIN + 50.0, until=BEGIN + 350.0))
    np.testing.assert_array_equal(first[1].op, sticky.op[50:200])
    np.testing.assert_array_equal(second[1].op, sticky.op[200:350])


def test_a_parquet_file_of_a_historians_texts_is_read(tmp_path: Path, sticky) -> None:
    """As ``identify`` reads it: text with words for bad values, durations, loops of any type."""
    texts = [repr(float(value)) for value in sticky.pv]
    texts[7], texts[9] = "I/O Timeout", None
    for folder, loops in (("flag", [True] * 400), ("bytes", [b"true"] * 400)):
        times = pa.array(np.arange(400) * 10**6, pa.duration("us"))
        pv = pa.array(texts).dictionary_encode()
        table = pa.table({"loop": loops, "time": times, "op": sticky.op, "pv": pv})
        (tmp_path / folder).mkdir()
        pq.write_table(table, tmp_path / folder / "x.parquet")
        ((name, found),) = windows(place_of(str(tmp_path / folder)), Cut())
        assert (name, found.period) == ("true", 1.0)
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.pv)), [7, 9])
    texts[11] = "hello"
    pq.write_table(pa.table({"op": sticky.op, "pv": pa.array(texts)}), tmp_path / "y.parquet")
    with pytest.raises(
        ReadingError, match="column pv holds the text 'hello', which is not a number"
    ):
        windows(place_of(str(tmp_path / "y.parquet")), Cut())


def test_half_a_parquet_file_is_no_defect_of_ours(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_bytes(b"PAR1" + bytes(100))
    with pytest.raises(ReadingError, match=r"cannot be read as Parquet .*; export it again"):
        windows(place_of(str(tmp_path)), Cut())


def test_a_parquet_file_with_two_columns_of_one_name_is_one_sentence(tmp_path: Path) -> None:
    zeros = pa.array(np.zeros(60))
    table = pa.Table.from_arrays([zeros, zeros, zeros], names=["op", "pv", "pv"])
    pq.write_table(table, tmp_path / "x.parquet")
    with pytest.raises(ReadingError, match=r"cannot be read as Parquet .*; export it again"):
        windows(place_of(str(tmp_path)), Cut())


@pytest.mark.parametrize("make", [as_csv, as_parquet, as_historian, as_moments, as_values])
@pytest.mark.parametrize("mark", [3.4028234663852886e38, -1e39])
def test_the_largest_float_marks_a_bad_sample_wherever_it_is_stored(
    tmp_path: Path, sticky, make: Callable[..., Place], mark: float
) -> None:
    pv = sticky.pv.copy()
    pv[7] = mark
    found = dict(windows(make(tmp_path, sticky.op, pv), Cut()))["FC101"]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.pv)), [7])


@pytest.mark.parametrize("make", [as_csv, as_parquet, as_moments, as_values])
def test_a_number_that_stands_for_none_is_a_bad_sample_wherever_it_is_stored(
    tmp_path: Path, sticky, make: Callable[..., Place]
) -> None:
    op = sticky.op.copy()
    op[7] = -9999.0
    found = dict(windows(make(tmp_path, op, sticky.pv), Cut()))["FC101"]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.op)), [7])
    assert found.notes[0].startswith("op: -9999 at 1 row, far from the others")


def test_a_store_whose_name_means_something_in_an_address_is_read(tmp_path: Path, sticky) -> None:
    as_historian(tmp_path, sticky.op, sticky.pv)
    for name in ("a?b=c", "a%20b"):
        folder = tmp_path / name
        folder.mkdir()
        shutil.copy(tmp_path / "history.sqlite", folder / f"{name}.sqlite")
        ((loop, found),) = windows(place_of(str(folder)), Cut())
        assert (loop, len(found)) == ("FC101", 400)


def test_the_record_of_something_else_and_of_an_older_release_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("op,pv\n")
    for text, words in (
        ('{"loops": 1, "rows": 1, "errors": 0}', "is not the record of a run"),
        ("[]", "is not the record of a run"),
        (
            json.dumps({"loops": 1, "rows": 1, "errors": 0, "options": {}}),
            "holds a run with other places",
        ),
    ):
        (tmp_path / "out").mkdir(exist_ok=True)
        (tmp_path / "out" / "run.json").write_text(text)
        done = run_typed(tmp_path, "assess", "a.csv", "--out", "out")
        assert done.returncode == 2
        assert words in " ".join(done.stderr.split())


def test_a_full_disk_is_one_sentence_and_loses_nothing_that_was_stored(tmp_path: Path) -> None:
    file = RunFile(tmp_path / "run.sqlite")
    pieces = [Piece(0, f"F{number}") for number in range(200)]
    file.plan(pieces)
    done = [(number, [error_row(f"F{number}", "L", "", "x" * 500)]) for number in range(1, 201)]
    file.store(done[:20])
    used = file._db.execute("PRAGMA page_count").fetchone()[0]
    file._db.execute(f"PRAGMA max_page_count = {used + 2}")
    with pytest.raises(AssessError, match=r"run\.sqlite cannot be used \(database or disk is full"):
        file.store(done[20:])
    assert file.counts().rows == 20
    file._db.execute(f"PRAGMA max_page_count = {used + 1000}")
    file.store(done[20:])
    assert file.counts().rows == 200
    file.close()


def test_a_store_is_read_while_it_is_written(tmp_path: Path, sticky) -> None:
    place = as_historian(tmp_path, sticky.op[:200], sticky.pv[:200])
    job = Job((place,))
    reader = reader_of(place.kind)
    pieces = [piece for piece in reader.pieces(job, 0, "") if isinstance(piece, Piece)]
    writer = sqlite3.connect(tmp_path / "history.sqlite", isolation_level=None)
    writer.execute("BEGIN IMMEDIATE")
    writer.execute("UPDATE samples SET op = 0")
    ((_, found),) = [window for piece in pieces for window in reader.windows(job, piece)]
    np.testing.assert_array_equal(found.op, sticky.op[:200])
    writer.execute("ROLLBACK")
    writer.close()


def test_a_parquet_files_quality_and_mode_count_as_in_a_text_file(tmp_path: Path, sticky) -> None:
    """A historian marks a bad value beside it; a mode in words is one, in numbers it may not be."""
    stamps = pa.array((BEGIN + np.arange(400.0)) * 1e6).cast(pa.int64()).cast(pa.timestamp("us"))
    quality = ["Bad" if k in (7, 9) else "Good" for k in range(400)]
    codes = pa.array([0 if k == 5 else 192 for k in range(400)]).dictionary_encode()
    mode = ["MAN" if k < 20 else "AUTO" for k in range(400)]
    columns = {"time": stamps, "op": sticky.op, "pv": sticky.pv}
    for name, more in (
        ("words", {"PV.Quality": quality, "status": codes, "mode": mode}),
        ("numbers", {"mode": [3] * 400}),
    ):
        pq.write_table(pa.table(columns | more), tmp_path / f"{name}.parquet")
    ((_, words),) = windows(place_of(str(tmp_path / "words.parquet")), Cut())
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(words.pv)), [5, 7, 9])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(words.op)), [5])
    assert words.auto is not None
    np.testing.assert_array_equal(words.auto, np.arange(400) >= 20)
    assert words.notes == (
        "PV.Quality: 2 rows are not good: bad samples",
        "status: 1 rows are not good: bad samples",
    )
    ((_, numbers),) = windows(place_of(str(tmp_path / "numbers.parquet")), Cut())
    assert numbers.auto is None
    assert "name it with --auto" in numbers.notes[0]


def test_packed_files_have_a_row_and_hidden_ones_none(tmp_path: Path, sticky) -> None:
    write_csv(tmp_path / "FC101.csv", sticky)
    (tmp_path / "FC102.csv.gz").write_bytes(gzip.compress((tmp_path / "FC101.csv").read_bytes()))
    for name in (".snapshot/FC101.csv", "._FC101.csv", "~$FC101.xlsx"):
        write_csv(tmp_path / name, sticky)
    pq.write_table(pa.table({"op": sticky.op, "pv": sticky.pv}), tmp_path / "FC103.pq")
    job = Job((place_of(str(tmp_path)),), Columns(), Cut())
    reader = reader_of("files")
    pieces = [piece for piece in reader.pieces(job, 0, "") if isinstance(piece, Piece)]
    assert [Path(piece.path).name for piece in pieces] == ["FC101.csv", "FC102.csv.gz", "FC103.pq"]
    with pytest.raises(RecordingError, match="is packed"):
        next(reader.windows(job, pieces[1]))
    assert next(reader.windows(job, pieces[2]))[0] == "FC103"


def test_rows_of_a_parquet_file_without_a_loops_name_are_one_loop(tmp_path: Path, sticky) -> None:
    times = pa.array(BEGIN + np.arange(400.0))
    loops = [None, ""] * 100 + ["FC2"] * 200
    table = pa.table({"time": times, "loop": loops, "op": sticky.op, "pv": sticky.pv})
    pq.write_table(table, tmp_path / "FC1.parquet")
    found = windows(place_of(str(tmp_path)), Cut())
    assert [(name, len(window)) for name, window in found] == [("FC1", 200), ("FC2", 200)]


def test_the_description_of_a_table_is_told_from_a_site_file(tmp_path: Path) -> None:
    """It was called a site file with many errors; an empty table asked for other places."""
    with sqlite3.connect(tmp_path / "plant.db") as db:
        db.execute("CREATE TABLE hist (ts INTEGER, name TEXT, op REAL, pv REAL)")
    db.close()
    description = tmp_path / "plant.toml"
    description.write_text(
        '[sql]\nurl = "sqlite:///plant.db"\ntable = "hist"\ntime = "ts"\nloop = "name"\n'
        'op = "op"\npv = "pv"\n'
    )
    with pytest.raises(SiteError, match=r"historian's SQL table, .*; give"):
        load_site(description)
    done = run_typed(tmp_path, "assess", "plant.toml", "--out", "out", "--workers", 1)
    assert "nothing to assess; the table has no rows of OP and PV: check sql.table" in done.stderr
