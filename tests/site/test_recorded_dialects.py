"""Recordings as historians, spreadsheets and MATLAB write them: one loop in every dialect."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from fieldlink.site import Recording, RecordingError, read_recording

N = 120
OP = np.round(40.0 + 10.0 * np.sin(np.arange(N) / 9.0), 3)
PV = np.round(OP + 1.5, 3)
BERLIN = ZoneInfo("Europe/Berlin")


def lines(head: str, row: Callable[[int], str], order: list[int] | None = None) -> str:
    return "\n".join([head, *(row(k) for k in order or range(N))]) + "\n"


def stamp(k: int, begin: str = "2026-03-04T10:00:00", *, local: bool = False) -> datetime:
    moment = datetime.fromisoformat(begin).replace(tzinfo=UTC) + timedelta(seconds=2 * k)
    return moment.astimezone(BERLIN).replace(tzinfo=None) if local else moment


def comma(value: float) -> str:
    return f"{value:.3f}".replace(".", ",")


def grouped(value: float, mark: str, decimal: str = ".") -> str:
    text = f"{1000 * value:,.2f}".replace(",", "G").replace(".", decimal)
    return text.replace("G", mark)


def plain(k: int, pv: object = None) -> str:
    return f"{stamp(k):%Y-%m-%d %H:%M:%S},{OP[k]},{PV[k] if pv is None else pv}"


def check(recording: Recording, *, scale: float = 1.0, bad: int = 0) -> None:
    """The loop of this file, with ``bad`` samples of PV left out."""
    assert len(recording) == N
    assert recording.period == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(recording.op, OP)
    known = ~np.isnan(recording.pv)
    assert int((~known).sum()) == bad
    np.testing.assert_allclose(recording.pv[known], scale * PV[known])


@pytest.mark.parametrize(
    "text",
    {
        "units": lines("Time,FC1.OP,FC1.PV\n,%,m3/h", plain),
        "descriptions": lines("Time,FC1.OP,FC1.PV\nTimestamp,Valve,Flow\ns,%,m3/h", plain),
        "tag above signal": lines(",FC101,FC101\nTime,OP,PV", plain),
        "titles and a count": lines("Export\nfrom the mill\n\nTime,FC1.OP,FC1.PV", plain)
        + "\n120 rows\n",
        "sep": lines("sep=;\nZeit;OP;PV", lambda k: f"{2 * k};{comma(OP[k])};{comma(PV[k])}"),
        "bars": lines("time|op|pv", lambda k: f"{2 * k}|{OP[k]}|{PV[k]}"),
        "blanks": lines(
            "  time     op    pv", lambda k: f"{2 * k:8.1f} {OP[k]:8.3f}  {PV[k]:8.3f}"
        ),
        "percent": lines("time;op;pv", lambda k: f"{2 * k};{comma(OP[k])} %;{comma(PV[k])} m3/h"),
        "DeltaV": lines("Date/Time,TIC1/OUT.CV,TIC1/PV.CV", plain),
        "PI": lines(r"Timestamp,\\S\FC1.OUT - Average,\\S\FC1.MEAS - Average", plain),
        "French": lines("Horodatage;Sortie;Mesure", lambda k: plain(k).replace(",", ";")),
        "milliseconds": lines("t,op,pv", lambda k: f"{1772618400000 + 2000 * k},{OP[k]},{PV[k]}"),
        "nanoseconds": lines(
            "t,op,pv", lambda k: f"{(1772618400 + 2 * k) * 10**9},{OP[k]},{PV[k]}"
        ),
        "days": lines("time,op,pv", lambda k: f"{46085.5 + k / 43200:.9f},{OP[k]},{PV[k]}"),
        "date beside time": lines(
            "Datum;Uhrzeit;OP;PV",
            lambda k: f"{stamp(k):%d.%m.%Y;%H:%M:%S};{comma(OP[k])};{comma(PV[k])}",
        ),
        "colon": lines("t,op,pv", lambda k: f"{stamp(k):%Y-%m-%d %H:%M:%S}:000,{OP[k]},{PV[k]}"),
        "minutes": lines("t,op,pv", lambda k: f"{stamp(k):%d.%m.%Y %H:%M},{OP[k]},{PV[k]}"),
        "newest first": lines("time,op,pv", plain, list(range(N))[::-1]),
        "unsorted": lines("time,op,pv", plain, [*range(60, N), *range(60)]),
        "repeated": lines("time,op,pv", plain, sorted([*range(N), 7, 60])),
        "early stamps": lines(
            "time,op,pv", lambda k: f"{stamp(k - (k % 40 == 30))},{OP[k]},{PV[k]}"
        ),
        "end of summer": lines(
            "t,op,pv",
            lambda k: f"{stamp(k, '2026-10-25T00:58:00', local=True)},{OP[k]},{PV[k]}",
        ),
        "summer": lines(
            "t,op,pv",
            lambda k: f"{stamp(k, '2026-03-29T00:58:00', local=True)},{OP[k]},{PV[k]}",
        ),
    }.items(),
    ids=lambda case: case[0],
)
def test_a_dialect(text: tuple[str, str], tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(text[1])
    check(read_recording(path))


@pytest.mark.parametrize(
    ("separator", "cell"),
    [
        (",", lambda v: f'"{grouped(v, ",")}"'),
        (";", lambda v: grouped(v, ".", ",")),
        (";", lambda v: grouped(v, " ", ",")),
        (";", lambda v: grouped(v, "\u2019")),
    ],
    ids=["English", "German", "French", "Swiss"],
)
def test_grouped_digits(separator: str, cell: Callable[[float], str], tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    head = separator.join(("time", "op", "pv"))
    path.write_text(
        lines(head, lambda k: separator.join((str(2 * k), str(OP[k]), cell(PV[k])))), "utf-8"
    )
    check(read_recording(path), scale=1000.0)


@pytest.mark.parametrize(
    "word",
    [
        "Bad", "I/O Timeout", "#N/A", "No Data", "-", "inf", "Pt Created", "3.40282e+38", "-1e39",
        "[-11059] No Good Data For Calculation",
    ],
)  # fmt: skip
def test_words_for_bad_values_are_bad_samples(word: str, tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("time,op,pv", lambda k: plain(k, word if k % 40 == 5 else None)))
    recording = read_recording(path)
    check(recording, bad=3)
    assert any(f"{word!r} in 3 rows" in note for note in recording.notes)


@pytest.mark.parametrize(
    "word", ["#N/A", "#NV", "#REF!", "#DIV/0!", "#WERT!", "#\u00a1VALOR!", "#NAME?", "####"]
)
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_row_that_begins_with_an_error_of_a_spreadsheet_is_a_bad_sample(
    word: str, mark: str, tmp_path: Path
) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(
        lines(
            f"# exported\npv{mark}op",
            lambda k: (
                f"{word if k % 40 == 5 else PV[k]}{mark}{OP[k]}"
                + ("\n#N/A is what the export writes, not a row" if k == 9 else "")
            ),
        ),
        "utf-8",
    )
    recording = read_recording(path, period=2.0)
    check(recording, bad=3)
    assert f"pv: {word!r} in 3 rows: bad samples" in recording.notes


@pytest.mark.parametrize("word", ["Bad", "I/O Timeout", "", "#N/A"])
@pytest.mark.parametrize("head", ["time,op,pv", "time,op,pv\ns,%,m3/h", "Export\ntime,op,pv"])
@pytest.mark.parametrize("count", [5, 30])
@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S", "%d-%b-%y %H:%M:%S", "%I:%M:%S %p"])
def test_a_record_may_begin_with_bad_rows(
    word: str, head: str, count: int, form: str, tmp_path: Path
) -> None:
    path = tmp_path / "loop.csv"

    def row(k: int) -> str:
        values = f"{word},{word}" if k < count else f"{OP[k]},{PV[k]}"
        return f"{stamp(k).strftime(form)},{values}"

    path.write_text(lines(head, row))
    recording = read_recording(path)
    assert np.flatnonzero(np.isnan(recording.op)).tolist() == list(range(count))
    np.testing.assert_allclose(recording.pv[count:], PV[count:])


def test_bad_rows_without_a_time_are_bad_samples(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("op,pv", lambda k: "Bad,Bad" if k < 9 else f"{OP[k]},{PV[k]}"))
    recording = read_recording(path, period=2.0)
    assert np.flatnonzero(np.isnan(recording.op)).tolist() == list(range(9))


@pytest.mark.parametrize("head", ["# time,op,pv", "#time,op,pv", "# of a mill\n# time,op,pv"])
@pytest.mark.parametrize("mark", [",", ";", " "])
def test_a_header_may_be_a_comment(head: str, mark: str, tmp_path: Path) -> None:
    """As numpy.savetxt writes it."""
    path = tmp_path / "loop.csv"
    text = lines(head, lambda k: f"{2 * k},{OP[k]},{PV[k]}")
    path.write_text(text.replace(",", mark))
    check(read_recording(path))


def test_decimal_commas_between_blanks(tmp_path: Path) -> None:
    path = tmp_path / "loop.txt"
    path.write_text(lines("time op pv", lambda k: f"{2 * k} {comma(OP[k])} {comma(PV[k])}"))
    check(read_recording(path))


def test_one_column_is_not_two_signals(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("time,op,pv", plain))
    with pytest.raises(RecordingError, match="1: pv: is meant as op and pv at once; name another"):
        read_recording(path, op="pv", pv="PV")


def test_durations_in_a_workbook(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["time", "op", "pv"])
    for k in range(N):
        book.active.append([timedelta(minutes=20 * k), OP[k], PV[k]])
        book.active.cell(k + 2, 1).number_format = "[h]:mm:ss"
    book.save(tmp_path / "loop.xlsx")
    recording = read_recording(tmp_path / "loop.xlsx")
    assert (len(recording), recording.period, recording.irregular) == (N, 1200.0, 0)


@pytest.mark.parametrize("other", ["0", "10682368"])
def test_codes_of_more_than_16_bits_are_those_of_opc_ua(other: str, tmp_path: Path) -> None:
    """Below 2^30 all of them are good, 0 too, which is bad in OPC Data Access."""
    path = tmp_path / "loop.csv"
    path.write_text(
        lines("time,op,pv,quality", lambda k: f"{plain(k)},{10682368 if k % 9 else other}")
    )
    check(read_recording(path))


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ("Good", "Bad"),
        ("Good NonSpecific", ""),
        ("192", "0"),
        ("216", "24"),
        ("0xC0", "0x00"),
        ("0", "2147483648"),  # BadUnexpectedError and others begin with 0x80
        ("0", "1073741824"),  # Uncertain
        ("0x00000000", "0x80350000"),  # BadAttributeIdInvalid
        ("0", "-2147483648"),  # the same 32 bits with a sign
        ("10682368", "2147483648"),  # 0x00A30000: severity 00
    ],
)
def test_a_column_of_quality_leaves_bad_values_out(good: str, bad: str, tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    head = "time,FC1.OP,FC1.PV,FC1.PV.Quality"
    path.write_text(
        lines(head, lambda k: f"{plain(k, 999)},{bad}" if k % 40 == 5 else f"{plain(k)},{good}")
    )
    check(read_recording(path), bad=3)


def test_words_that_begin_with_good_are_good(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    words = ["Good", "Good NonSpecific", "Good, annotated"]
    path.write_text(lines("time,op,pv,quality", lambda k: f'{plain(k)},"{words[k % 3]}"'))
    check(read_recording(path))


def test_matlab_excel_and_parquet(tmp_path: Path) -> None:
    pandas, _ = pytest.importorskip("pandas"), pytest.importorskip("openpyxl")
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    savemat(tmp_path / "5.mat", {"op": OP, "pv": PV, "Ts": 2.0})
    savemat(tmp_path / "4.mat", {"op": OP, "pv": PV, "Ts": 2.0}, format="4")
    savemat(tmp_path / "struct.mat", {"loop": {"OP": OP, "PV": PV, "Ts": 2.0}})
    frame = pandas.DataFrame({"Time": [stamp(k).replace(tzinfo=None) for k in range(N)]})
    frame["FC1.OP"], frame["FC1.PV"] = OP, PV
    frame.to_excel(tmp_path / "loop.xlsx", index=False)
    for unit in ("s", "ms", "us", "ns"):
        times = arrow.array(frame["Time"]).cast(arrow.timestamp(unit))
        op = arrow.array([str(value) for value in OP]).cast(arrow.decimal128(9, 3))
        table = arrow.table({"time": times, "op": op, "pv": arrow.array(PV).dictionary_encode()})
        parquet.write_table(table, tmp_path / f"{unit}.parquet")
    for path in sorted(tmp_path.iterdir()):
        check(read_recording(path))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"op": OP, "pv": PV[:-3]}, f"pv is a vector of {N - 3} samples, and other signals have"),
        ({"op": np.zeros((N, 2)), "pv": PV}, f"op is an array of {N} x 2"),
        ({"op": np.array(OP) + 1j, "pv": PV}, "op is complex"),
        ({"op": 3.0, "pv": PV}, "op is one number"),
        ({"A": {"op": OP, "pv": PV}, "B": {"op": OP, "pv": PV}}, "holds 2 structures, A, B; save"),
    ],
)
def test_signals_of_matlab_that_are_no_vectors_of_one_length(
    values: dict[str, Any], said: str, tmp_path: Path
) -> None:
    savemat(tmp_path / "loop.mat", values)
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / "loop.mat")


def test_a_quote_that_is_never_closed_is_named(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("time,op,pv", lambda k: ('"' if k == 7 else "") + plain(k)))
    with pytest.raises(RecordingError, match="line 9: a quote begins there that is never closed"):
        read_recording(path)


@pytest.mark.parametrize("word", ["I/O Timeout", "1e200"])
def test_a_column_without_a_number_says_what_it_holds(word: str, tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("op,pv", lambda k: f"{OP[k]},{word}"))
    with pytest.raises(RecordingError, match=f"pv: holds no number at all, only '{word}' and the"):
        read_recording(path)


def test_a_sparse_vector_of_matlab(tmp_path: Path) -> None:
    savemat(tmp_path / "loop.mat", {"op": csc_matrix(np.array([OP]).T), "pv": PV, "Ts": 2.0})
    check(read_recording(tmp_path / "loop.mat"))


def test_the_columns_of_a_matrix_of_matlab_can_be_named(tmp_path: Path) -> None:
    savemat(tmp_path / "tall.mat", {"data": np.column_stack([OP, PV]), "Ts": 2.0})
    savemat(tmp_path / "wide.mat", {"data": np.vstack([OP, PV]), "Ts": 2.0})
    for path in sorted(tmp_path.iterdir()):
        check(read_recording(path, op="column1", pv="column2"))
        with pytest.raises(RecordingError, match="column1, column2"):
            read_recording(path)


@pytest.mark.parametrize("heading", ["", "When"])
def test_a_column_of_moments_is_the_time_whatever_its_heading(tmp_path: Path, heading: str) -> None:
    """What pandas writes for an index of moments has no heading."""
    (tmp_path / "loop.csv").write_text(lines(f"{heading},op,pv", plain))
    found = read_recording(tmp_path / "loop.csv")
    check(found)
    assert any("holds dates or times of day" in note for note in found.notes)


def test_a_column_of_row_numbers_without_a_heading_is_no_time(tmp_path: Path) -> None:
    text = lines(",op,pv", lambda k: f"{k},{OP[k]},{PV[k]}")
    (tmp_path / "loop.csv").write_text(text)
    assert read_recording(tmp_path / "loop.csv").time is None


def test_in_an_export_of_the_historian_0_is_good(tmp_path: Path) -> None:
    head = "time,loop,slot,op,pv,sp,auto,quality,late_ms,clock_steps"
    text = lines(
        head,
        lambda k: f"{stamp(k):%Y-%m-%dT%H:%M:%SZ},A,{k},{OP[k]},{PV[k]},,,{10 * (k == 7)},3,0",
    )
    (tmp_path / "loop.csv").write_text(text)
    found = read_recording(tmp_path / "loop.csv")
    assert np.flatnonzero(np.isnan(found.op)).tolist() == [7]
    assert np.flatnonzero(np.isnan(found.pv)).tolist() == [7]
    assert found.sp is None
    assert found.auto is None
    assert any("1 rows are not good" in note for note in found.notes)


def test_exponents_of_fortran_are_no_unit(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text(lines("Time,op,pv", lambda k: plain(k, f"{PV[k]:.8E}".replace("E", "D"))))
    check(read_recording(path))


@pytest.mark.parametrize("given", ["2 s", 0.0, -1.0, np.nan, np.inf, 2j])
def test_a_period_of_matlab_that_is_none_is_asked_for(given: object, tmp_path: Path) -> None:
    """A text ended in a traceback, and -1, which Simulink has for inherited, turned the rows."""
    path = tmp_path / "loop.mat"
    savemat(path, {"op": OP, "pv": PV, "Ts": given})
    with pytest.raises(RecordingError, match="give the seconds between rows with --period"):
        read_recording(path)
    found = read_recording(path, period=2.0)
    assert found.period == 2.0
    assert found.op[:3] == pytest.approx(OP[:3])
