"""Every kind of place gives the same samples, and windows begin where they should."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from openpyxl import Workbook
from scipy.io import savemat

from fieldlink.assess import Columns, Cut, Job, Piece, Place
from fieldlink.assess.cutting import cut_windows
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.places import place_of
from fieldlink.assess.readers.registry import reader_of
from fieldlink.assess.series import Series
from fieldlink.site import RecordingError, SiteError, read_recording
from fieldlink.store import EventRecord, Historian, SampleRecord

BEGIN = 1_767_225_600
"""2026-01-01T00:00:00Z."""


def windows(place: Place, cut: Cut, **columns: object) -> list[tuple[str, Series]]:
    """All windows of a place, as a worker reads them."""
    job = Job((place,), Columns(**columns), cut)  # type: ignore[arg-type]
    reader = reader_of(place.kind)
    pieces = [piece for piece in reader.pieces(job, 0, "") if isinstance(piece, Piece)]
    return [window for piece in pieces for window in reader.windows(job, piece)]


def as_csv(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    stamps = np.datetime64(BEGIN, "s") + np.arange(op.size)
    lines = [
        f"{t}Z,FC101,{o!r},{p!r}" for t, o, p in zip(stamps, op.tolist(), pv.tolist(), strict=True)
    ]
    (folder / "x.csv").write_text("\n".join(["time,loop,op,pv", *lines]))
    return place_of(str(folder / "x.csv"))


def as_workbook(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    book = Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["time", "loop", "op", "pv"])
    for k, (o, p) in enumerate(zip(op.tolist(), pv.tolist(), strict=True)):
        sheet.append([datetime.fromtimestamp(BEGIN + k, UTC).replace(tzinfo=None), "FC101", o, p])
    book.save(folder / "x.xlsx")
    return place_of(str(folder))


def as_parquet(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    times = pa.array(1000 * (BEGIN + np.arange(op.size)), pa.timestamp("ms", "UTC"))
    both = {"OP": [*op, *pv], "PV": [*pv, *op], "time": pa.concat_arrays([times, times])}
    both["loop"] = pa.array(["FC101"] * op.size + ["other"] * op.size)
    pq.write_table(pa.table(both), folder / "x.parquet", row_group_size=150)
    return place_of(str(folder))


def as_historian(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    historian = Historian(f"sqlite:///{folder}/history.sqlite")
    historian.start(EventRecord(0, "daemon.started", "daemon", ""))
    for k, (o, p) in enumerate(zip(op.tolist(), pv.tolist(), strict=True)):
        historian.put(SampleRecord("FC101", 1000 * (BEGIN + k), k, o, p, None, None, 0))
    historian.stop()
    return place_of(f"sqlite:///{folder}/history.sqlite")


def as_moments(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    with sqlite3.connect(folder / "plant.db") as db:
        db.execute("CREATE TABLE hist (ts TIMESTAMP, name TEXT, out REAL, value REAL)")
        stamps = np.datetime64(BEGIN, "s") + np.arange(op.size)
        texts = [f"{str(t).replace('T', ' ')}.000000" for t in stamps]
        names = ["FC101"] * op.size
        db.executemany(
            "INSERT INTO hist VALUES (?, ?, ?, ?)", zip(texts, names, op, pv, strict=True)
        )
    db.close()
    (folder / "x.toml").write_text(
        '[sql]\nurl = "sqlite:///plant.db"\ntable = "hist"\ntime = "ts"\nloop = "name"\n'
        'op = "out"\npv = "value"\n'
    )
    return place_of(str(folder / "x.toml"))


def as_values(folder: Path, op: np.ndarray, pv: np.ndarray) -> Place:
    with sqlite3.connect(folder / "plant.db") as db:
        db.execute("CREATE TABLE hist (ts INTEGER, tag TEXT, val REAL, q INTEGER)")
        for tag, values in (("FC101.OP", op), ("FC101.PV", pv)):
            rows = [(1000 * (BEGIN + k), tag, v, 192) for k, v in enumerate(values.tolist())]
            db.executemany("INSERT INTO hist VALUES (?, ?, ?, ?)", rows)
        db.execute("INSERT INTO hist VALUES (?, 'FC101.PV', 1e9, 0)", [1000 * BEGIN + 500])
        db.execute("INSERT INTO hist VALUES (?, 'FC101.MODE', 1, 192)", [1000 * BEGIN - 9000])
    db.close()
    (folder / "x.toml").write_text(
        '[sql]\nurl = "sqlite:///plant.db"\ntable = "hist"\ntime = "ts"\ntime_unit = "ms"\n'
        'tag = "tag"\nvalue = "val"\nquality = "q"\ngood = [192]\n'
        'tags = { op = "{loop}.OP", pv = "{loop}.PV", auto = "{loop}.MODE" }\n'
    )
    return place_of(str(folder / "x.toml"))


MAKERS = [as_csv, as_workbook, as_parquet, as_historian, as_moments, as_values]


@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
def test_every_kind_of_place_gives_the_samples_that_were_recorded(
    tmp_path: Path, sticky, make: Callable[..., Place]
) -> None:
    place = make(tmp_path, sticky.op, sticky.pv)
    # From the 100th second on, a window every 100 s, in the clock's own hundreds.
    cut = Cut(since=BEGIN + 100.0, until=BEGIN + 350.0, every=100.0, samples=80)
    found = [window for loop, window in windows(place, cut) if loop == "FC101"]
    assert [window.time[0] for window in found] == [BEGIN + 100.0, BEGIN + 200.0, BEGIN + 300.0]
    assert [len(window) for window in found] == [80, 80, 50]
    assert all(window.period == 1.0 and window.dated for window in found)
    # A workbook has 15 digits.
    np.testing.assert_allclose(found[1].op, sticky.op[200:280], rtol=1e-14)
    np.testing.assert_allclose(found[2].pv, sticky.pv[300:350], rtol=1e-14)
    if make is as_values:
        assert found[0].auto is not None
        assert (found[0].auto == 1.0).all()


def test_the_data_base_of_stiction_is_read_loop_by_loop(tmp_path: Path, sticky) -> None:
    loop = {"OP": sticky.op, "PV": sticky.pv, "SP": sticky.op, "Ts": 5.0, "comments": "made up"}
    savemat(tmp_path / "isdb.mat", {"cdata": {"chemicals": {"loop10": loop, "loop2": loop}}})
    found = windows(place_of(str(tmp_path)), Cut())
    assert [name for name, _ in found] == ["chemicals.loop10", "chemicals.loop2"]
    np.testing.assert_array_equal(found[0][1].op, sticky.op)
    assert found[0][1].period == 5.0


class Stretch:
    """Samples at given seconds, the sample's number as OP."""

    dated = False

    def __init__(self, time: np.ndarray) -> None:
        self._time = time.astype(float)
        self.first, self.last = float(time[0]), float(time[-1])

    def fetch(self, since: float, until: float, rows: int) -> Series:
        kept = np.flatnonzero((self._time >= since) & (self._time < until))[:rows]
        op = kept.astype(float)
        return Series(self._time[kept], op, op, None, None, 1.0, dated=self.dated)


def lengths(time: np.ndarray, cut: Cut) -> list[int]:
    return [len(window) for window in cut_windows(Stretch(time), Piece(0, "f"), cut)]


def test_windows_follow_each_other_and_a_short_rest_is_joined_to_the_last() -> None:
    assert lengths(np.arange(1000), Cut(samples=1000)) == [1000]
    assert lengths(np.arange(1400), Cut(samples=1000)) == [1400]
    assert lengths(np.arange(2600), Cut(samples=1000)) == [1000, 1000, 600]


def test_a_missing_sample_is_left_open_and_a_long_gap_ends_a_window() -> None:
    time = np.concatenate([np.arange(0, 100), np.arange(103, 300), np.arange(5000, 5200)])
    found = list(cut_windows(Stretch(time), Piece(0, "f"), Cut(samples=1000)))
    assert [(window.time[0], len(window)) for window in found] == [(0.0, 300), (5000.0, 200)]
    assert np.isnan(found[0].op[100:103]).all()
    assert found[0].op[103] == 100.0


def test_a_recording_without_dates_refuses_them() -> None:
    with pytest.raises(ReadingError, match="has no dates"):
        lengths(np.arange(500), Cut(since=BEGIN))
    with pytest.raises(ReadingError, match="no 50 samples in a row"):
        lengths(np.arange(40), Cut())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[sql]\nurl = "sqlite:///a.db"\ntable = "t"\ntime = "ts"\ntag = "n"\n', "go together"),
        ('[sql]\nurl = "sqlite:///a.db"\ntable = "t"\ntimes = "ts"\n', "did you mean 'time'"),
    ],
)
def test_a_wrong_description_is_refused_at_the_door(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(SiteError, match=words):
        place_of(str(tmp_path / "x.toml"))


def test_a_column_that_is_not_there_is_named_with_the_one_that_is(tmp_path: Path, sticky) -> None:
    place = as_moments(tmp_path, sticky.op, sticky.pv)
    (tmp_path / "x.toml").write_text((tmp_path / "x.toml").read_text().replace('"out"', '"outt"'))
    place = place_of(str(tmp_path / "x.toml"))
    with pytest.raises(ReadingError, match=r"no column 'outt' \(sql.op\); did you mean 'out'"):
        windows(place, Cut())


def test_a_password_is_neither_shown_nor_stored(tmp_path: Path) -> None:
    (tmp_path / "word").write_text("hidden\n")
    (tmp_path / "x.toml").write_text(
        '[sql]\nurl = "postgresql://reader@h/plant"\npassword_file = "word"\ntable = "t"\n'
        'time = "ts"\n'
    )
    for place in (place_of(str(tmp_path / "x.toml")), place_of("postgresql://r:hidden@h/plant")):
        assert "hidden" in place.where
        assert "hidden" not in place.shown
        assert "hidden" not in str(Job((place,)).options())


@pytest.mark.parametrize(("name", "count"), [("time_ms", 1000.0), ("Time [min]", 1 / 60)])
def test_the_unit_in_the_name_of_a_parquet_column_counts(
    name: str, count: float, tmp_path: Path
) -> None:
    values = np.arange(200.0)
    pq.write_table(
        pa.table({"op": values, "pv": -values, name: 2.0 * values * count}), tmp_path / "x.parquet"
    )
    ((_, window),) = windows(place_of(str(tmp_path / "x.parquet")), Cut(samples=200))
    assert window.period == pytest.approx(2.0)
    assert window.time[-1] == pytest.approx(398.0)


def test_numbers_that_cannot_be_seconds_are_refused(tmp_path: Path) -> None:
    values = np.arange(200.0)
    pq.write_table(
        pa.table({"op": values, "pv": -values, "time": 2e7 * values}), tmp_path / "x.parquet"
    )
    place = place_of(str(tmp_path / "x.parquet"))
    with pytest.raises(
        ReadingError, match="2e\\+07 s apart if they count seconds; name their unit"
    ):
        windows(place, Cut(samples=200))
    ((_, window),) = windows(place, Cut(samples=200), period=2.0)
    assert window.period == 2.0


def test_an_index_of_pandas_without_a_name_is_the_time(tmp_path: Path) -> None:
    index = pd.date_range("2026-01-01", periods=200, freq="2s")
    frame = pd.DataFrame({"op": np.arange(200.0), "pv": -np.arange(200.0)}, index=index)
    frame[::-1].to_parquet(tmp_path / "x.parquet")
    ((_, window),) = windows(place_of(str(tmp_path / "x.parquet")), Cut(samples=200))
    recording = read_recording(tmp_path / "x.parquet")
    for read in (window, recording):
        assert read.period == 2.0
        assert read.op.tolist() == list(range(200))
    assert window.time[0] == recording.start == BEGIN


def test_how_a_file_was_read_stays_with_its_windows(tmp_path: Path) -> None:
    rows = [f"{2000 * k},{k},{-k}" for k in range(200)]
    (tmp_path / "x.csv").write_text("\n".join(["time_ms,op,pv", *rows[::-1]]))
    ((_, window),) = windows(place_of(str(tmp_path / "x.csv")), Cut(samples=200))
    assert window.op.tolist() == list(range(200))
    assert "time_ms counts ms: taken as seconds" in window.notes
    assert "the rows are newest first: turned round" in window.notes


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("period", [2.0, 5.0])
def test_a_given_period_keeps_the_order_of_the_times(
    period: float, order: int, tmp_path: Path
) -> None:
    stamps = np.datetime64(BEGIN, "s") + 2 * np.arange(200)
    rows = [f"{stamp}Z,{k},{-k}" for k, stamp in enumerate(stamps)]
    (tmp_path / "x.csv").write_text("\n".join(["time,op,pv", *rows[::order]]))
    place = place_of(str(tmp_path / "x.csv"))
    ((_, window),) = windows(place, Cut(samples=200), period=period)
    assert window.op.tolist() == list(range(200))
    assert (window.period, window.time[0]) == (period, BEGIN)


def beside(**columns: np.ndarray) -> pd.DataFrame:
    """A table with a column of times and the given ones."""
    stamps = pd.date_range("2026-01-01", periods=400, freq="2s", tz="UTC")
    return pd.DataFrame({"Time Stamp": stamps, **columns})


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_loops_side_by_side_are_read_one_by_one(tmp_path: Path, kind: str) -> None:
    op, pv = np.arange(400.0) % 7.0, np.arange(400.0) % 5.0
    frame = beside(
        **{"FC1.OP": op, "FC1.PV": pv, "FC2.OP": op + 1, "FC2.PV": pv + 1, "FC2.SP": pv - pv},
        **{"TT3.PV": pv, "Kühler OUT (%)": op + 3, "Kühler PV (bar)": pv + 3},
    )
    if kind == "csv":
        frame.to_csv(tmp_path / "x.csv", index=False)
    else:
        frame.to_parquet(tmp_path / "x.parquet")
    found = dict(windows(place_of(str(tmp_path / f"x.{kind}")), Cut()))
    assert list(found) == ["FC1", "FC2", "Kühler"]
    for name, more in (("FC1", 0), ("FC2", 1), ("Kühler", 3)):
        np.testing.assert_array_equal(found[name].op, op + more)
        np.testing.assert_array_equal(found[name].pv, pv + more)
        assert found[name].time[0] == BEGIN
        assert found[name].period == 2.0
    assert found["FC1"].sp is None
    assert found["FC2"].sp is not None


def test_one_bad_loop_of_several_costs_the_others_nothing(tmp_path: Path) -> None:
    op, pv = np.arange(400.0) % 7.0, np.arange(400.0) % 5.0
    frame = beside(**{"A.OP": op, "A.PV": pv, "B.OP": op, "B.PV": pv})
    frame["A.PV"] = ["oops", *frame["A.PV"].astype(str)[1:]]
    frame.to_csv(tmp_path / "x.csv", index=False)
    reader, place = reader_of("files"), place_of(str(tmp_path))
    job = Job((place,), Columns(), Cut())
    (piece,) = (p for p in reader.pieces(job, 0, "") if isinstance(p, Piece))
    found = reader.windows(job, piece)
    assert next(found)[0] == "B"
    with pytest.raises(RecordingError, match=r"x\.csv:2: A\.PV: 'oops' is not a number") as caught:
        next(found)
    assert "B.PV" not in str(caught.value)
