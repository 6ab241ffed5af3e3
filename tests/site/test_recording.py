from __future__ import annotations

import gzip
import io
import lzma
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fieldlink.site import Recording, RecordingError, read_recording
from fieldlink.site.recording import NanRun, files_in, read_recordings

ROOT = Path(__file__).parents[2]
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a CSV file from a header and a row per sample, or from ready text or bytes."""

    def write(content: str | bytes, rows: Callable[[int], str] | None = None, n: int = 60) -> Path:
        path = tmp_path / "loop.csv"
        if isinstance(content, str):
            body = "" if rows is None else "".join(f"{rows(k)}\n" for k in range(n))
            content = f"{content}\n{body}".encode()
        path.write_bytes(content)
        return path

    return write


def plain(k: int) -> str:
    return f"{50 + k},{20 - k}"


def messages(path: Path, **options: object) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(path, **options)  # type: ignore[arg-type]
    return str(caught.value).replace(f"{path}:", "")


def test_a_row_is_a_second_without_time_and_period(write: Write) -> None:
    recording = read_recording(write("op,pv", plain))
    assert len(recording) == 60
    assert recording.op[:2].tolist() == [50.0, 51.0]
    assert recording.pv[:2].tolist() == [20.0, 19.0]
    assert (recording.period, recording.sp, recording.auto) == (1.0, None, None)
    assert "a row is taken for a second" in recording.notes[0]


def test_columns_are_found_in_any_case_and_order_among_others(write: Write) -> None:
    recording = read_recording(write("Comment,PV,Op,SP", lambda k: f"x,{k},{-k},7"))
    assert recording.pv[5] == 5.0
    assert recording.op[5] == -5.0
    assert recording.sp is not None
    assert recording.sp[0] == 7.0


def test_columns_are_named_on_request(write: Write) -> None:
    path = write("FIC1.OUT,FIC1.ME,op", lambda k: f"{k},{2 * k},x")
    recording = read_recording(path, op="fic1.out", pv="FIC1.ME", period=5.0)
    assert recording.pv[5] == 2 * recording.op[5] == 10.0
    assert recording.period == 5.0


@pytest.mark.parametrize(
    "content",
    [
        "op;pv\n" + "50,5;20,25\n" * 60,
        "op\tpv\n" + "50.5\t20.25\n" * 60,
        "op\tpv\r\n" + "50,5\t20,25\r\n" * 60,
        "op,pv\r" + "50.5,20.25\r" * 60,  # as old exports have it
        "op,pv,\n" + "50.5,20.25,\n" * 60,  # an empty column at the end
        "# exported\n\nop, pv\n" + " 50.5 , 20.25\n" * 60 + "\n\n",
    ],
)
def test_separators_decimal_commas_and_line_ends(content: str, write: Write) -> None:
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"):
        recording = read_recording(write(content.encode(encoding)))
        assert len(recording) == 60
        assert (recording.op[3], recording.pv[59]) == (50.5, 20.25)


def test_western_encoding_of_spreadsheets(write: Write) -> None:
    text = "op,pv,Temp °C\n" + "1,2,3\n2,3,4\n" * 30
    assert read_recording(write(text.encode("cp1252"))).pv[0] == 2.0


@pytest.mark.parametrize(
    ("stamp", "period"),
    [
        (lambda k: f"2025-02-23 21:{k // 6:02d}:{k % 6 * 10:02d}", 10.0),
        (lambda k: f"2025-02-23T21:{k // 6:02d}:{k % 6 * 10:02d}.500Z", 10.0),
        (lambda k: f"{13 + k // 24:02d}.02.2025 {k % 24:02d}:00", 3600.0),
        (lambda k: f"{1 + k // 24:02d}/02/2025 {k % 24:02d}:00", 3600.0),
        (lambda k: f"02/{1 + k // 24:02d}/2025 {k % 24:02d}:00:00", 3600.0),
        (
            lambda k: (
                f"{(23 * 3600 + 40 * k) // 3600 % 24}:{40 * k // 60 % 60:02d}:{40 * k % 60:02d}"
            ),
            40,
        ),
        (lambda k: f"{100 + 0.25 * k}", 0.25),
        (lambda k: "" if k == 30 else f"{2 * k}", 2.0),
    ],
    ids=["iso", "iso-z", "german", "british", "american", "midnight", "seconds", "gap"],
)
def test_the_period_is_the_median_interval(
    stamp: Callable[[int], str], period: float, write: Write
) -> None:
    recording = read_recording(write("time,op,pv", lambda k: f"{stamp(k)},{plain(k)}"))
    assert recording.period == pytest.approx(period)
    assert recording.irregular == 0
    assert recording.time is not None
    assert recording.time[10] == pytest.approx(10 * period)
    assert recording.notes == ()


def test_decimal_commas_in_numeric_times(write: Write) -> None:
    recording = read_recording(write("time;op;pv", lambda k: f"{k // 2},{k % 2 * 5};1;{k}"))
    assert recording.period == 0.5


def test_irregular_sampling_is_reported(write: Write) -> None:
    recording = read_recording(
        write("time,op,pv", lambda k: f"{10 * k + (300 if k >= 20 else 0)},{plain(k)}")
    )
    assert (recording.period, recording.irregular) == (10.0, 1)
    assert "1 of 59 intervals differ from 10 s" in recording.notes[0]
    assert "the longest is 310 s" in recording.notes[0]


def test_a_given_period_counts_more_than_an_unusable_clock(write: Write) -> None:
    path = write("time,op,pv", lambda k: f"{k % 3},{plain(k)}")
    assert "time: the times do not increase" in messages(
        write("time,op,pv", lambda k: f"5,{plain(k)}")
    )
    path = write("time,op,pv", lambda k: f"batch {k},{plain(k)}")
    assert "--period" in messages(path)
    assert read_recording(path, period=2.0).period == 2.0


def test_a_contradicting_clock_is_noted(write: Write) -> None:
    path = write("when,op,pv", lambda k: f"{k},{plain(k)}")
    recording = read_recording(path, time="when", period=10.0)
    assert recording.period == 10.0
    assert "says 1 s between rows; the given 10 s counts" in recording.notes[0]


def test_a_wrong_time_stamp_is_named_with_its_row(write: Write) -> None:
    path = write(
        "time,op,pv",
        lambda k: f"{'yesterday' if k == 4 else f'2025-01-01 00:00:{k:02d}'},{plain(k)}",
    )
    assert messages(path).startswith("6: time: 'yesterday' is not a date and time")


def test_empty_cells_are_bad_samples_and_counted(write: Write) -> None:
    def row(k: int) -> str:
        if k in (3, 4, 5):
            return f"{k},"
        return f"nan,{k}" if k == 59 else f"{k},{'NULL' if k == 10 else k}"

    recording = read_recording(write("op,pv", row), period=1.0)
    assert np.flatnonzero(np.isnan(recording.pv)).tolist() == [3, 4, 5, 10]
    assert recording.nan_runs == (NanRun("op", 59, 1), NanRun("pv", 3, 3), NanRun("pv", 10, 1))
    assert recording.notes == (
        "op: 1 bad sample in 1 run, at most 1 in a row",
        "pv: 4 bad samples in 2 runs, at most 3 in a row",
    )


def test_auto_may_be_words_or_numbers(write: Write) -> None:
    cells = ["1", "0", "AUTO", "MAN", "true", "False", "2", ""]
    recording = read_recording(write("op,pv,auto", lambda k: f"{plain(k)},{cells[k % 8]}"))
    assert recording.auto is not None
    assert recording.auto[:8].tolist() == [True, False, True, False, True, False, True, False]
    assert "auto: 'maybe' is neither yes nor no" in messages(
        write("op,pv,auto", lambda k: f"{plain(k)},maybe")
    )


def test_a_cut_keeps_what_belongs_to_its_rows(write: Write) -> None:
    path = write("time,op,pv,sp,auto", lambda k: f"{2 * k},{k},{'' if k == 12 else k},5,1")
    cut = read_recording(path).cut(slice(10, 50))
    assert len(cut) == 40
    assert cut.op[0] == 10.0
    assert cut.nan_runs == (NanRun("pv", 2, 1),)
    assert cut.period == 2.0
    with pytest.raises(ValueError, match="not a run of rows"):
        cut.cut(slice(0, 10, 2))


@pytest.mark.parametrize(
    ("content", "options", "expected"),
    [
        ("op,pv\n" + "1,2\n" * 49, {}, "has 49 rows, at least 50"),
        ("op,pv\n" + "1,x\n" * 60, {}, "2: pv: 'x' is not a number"),
        ("op,pv\n" + "1,1.234,5\n" * 60, {}, "2: 3 cells where the header has 2"),
        ("op,pv\n" + '1,"1,234"\n' * 60, {}, "'1,234' may be a decimal comma or grouped digits"),
        ("op,pv\n" + "1,inf\n" * 60, {}, "pv: holds no number at all"),
        ("time,op,pv\n" + "1,4,1,2,3\n" * 60, {}, "5 cells where the header has 3, as in 60 rows"),
        ("Time,Tag,Value\n" + "1,OP,2\n" * 60, {}, "pv: no tag of that name; use one of: OP"),
        ("2026-03-29 10:00,1,2\n" * 60, {}, "the first row holds values, no names"),
        ("op,pv,pv\n" + "1,2,3\n" * 60, {}, "they differ, so rename one of them"),
        ("op,pv\n" + "1,1_000\n" * 60, {}, "'1_000' is not a number"),
        ("op,pv\n" + "1,\n" * 60, {}, "pv: holds no number at all"),
        ("1,2\n" * 60, {}, "the first row holds values, no names"),
        (
            "op,flow\n" + "1,2\n" * 60,
            {},
            "1: pv: no column of that name; use one of: op, flow; call it pv, or choose it with "
            "--pv",
        ),
        ("操作量,測定値\n".encode("shift_jis") + b"1,2\n" * 60, {}, "save it as UTF-8"),
        (
            "op,pv,set\n" + "1,2,3\n" * 60,
            {"sp": "sets"},
            "no column of that name; did you mean",
        ),
        ("op,PV,Pv\n" + "1,2,3\n" * 60, {}, "several columns match: PV, Pv"),
        ("op,pv\n" + "1,2\n" * 60, {"period": 0.0}, "a period of 0.0 s is impossible"),
        ("", {}, "is empty"),
        (b"\x00\x01\x02", {}, "is not a CSV file: it is a binary file"),
        ("<html><table><tr><td>OP</td></tr></table></html>", {}, "open it in a spreadsheet"),
        ('<?xml version="1.0"?><Workbook/>', {}, "is HTML or XML text, whatever its name"),
        (b"PK\x03\x04 no workbook", {}, "is a binary file and no workbook"),
        (b"PAR1 and no more", {}, "cannot be read as Parquet"),
        (b"MATLAB 5.0 and no more", {}, "is not a MATLAB file that can be read"),
        (b"\xd0\xcf\x11\xe0 of 1997", {}, "save it as .xlsx or CSV"),
        ('op,pv\n"1,2\n' + "1,2\n" * 60, {}, "is not a CSV file"),
    ],
)
def test_bad_files_are_refused_with_place_and_remedy(
    content: str | bytes, options: dict[str, object], expected: str, write: Write
) -> None:
    assert expected in messages(write(content), **options)


def test_loops_of_one_table_are_not_taken_for_one(write: Write) -> None:
    text = "".join(f"{loop},{t},{t % 7},{t % 5}\n" for loop in ("FC1", "FC2") for t in range(60))
    path = write("loop,time,op,pv\n" + text)
    with pytest.raises(RecordingError, match="2 loops: 'FC1', 'FC2'; name one with --loop 'FC1'"):
        read_recording(path)
    assert [(name, len(found)) for name, found in read_recordings(path, {})] == [
        ("FC1", 60),
        ("FC2", 60),
    ]
    one = write("loop,time,op,pv\n" + text[: len(text) // 2])
    assert len(read_recording(one)) == 60


def test_many_wrong_cells_are_summed_up(write: Write) -> None:
    assert messages(write("op,pv", lambda k: f"{k},x")).splitlines() == [
        "2: pv: 'x' is not a number (and 59 more of this kind); "
        "correct it, or leave the cell empty where the sample is bad"
    ]
    lines = messages(write("op,pv", lambda k: f"{k},x{k}")).splitlines()
    assert len(lines) == 11
    assert any("50 more cells are wrong" in line for line in lines)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nowhere\.csv: cannot be read \(No such file"):
        read_recording(tmp_path / "nowhere.csv")


def outcome(path: Path) -> Recording | RecordingError:
    try:
        return read_recording(path)
    except RecordingError as error:
        return error


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60
)
@given(content=st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_any_file_is_a_recording_or_an_explained_error(content: bytes | str, write: Write) -> None:
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    for prefix in (b"", b"time,op,pv\n" + b"1,2,3\n" * 60):
        path = write(prefix + raw)
        found = outcome(path)
        assert str(path) in str(found) if isinstance(found, RecordingError) else len(found) >= 50


def test_real_recordings_are_read(shared_data: Path) -> None:
    plant = read_recording(shared_data / "plant" / "plant_01.csv")
    assert (len(plant), plant.period) == (751, 10.0)
    assert plant.auto is not None
    assert plant.auto.all()
    chem = read_recording(shared_data / "isdb" / "CHEM10.csv")
    assert len(chem) == 1000
    assert chem.op[0] == pytest.approx(0.89177)


def test_a_pipe_in_a_folder_of_recordings_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "FC1.csv").write_text("op,pv\n" + 60 * "1,2\n")
    os.mkfifo(tmp_path / "pipe.csv")
    assert files_in(tmp_path) == [tmp_path / "FC1.csv"]
    # one that is named itself is read, as a shell gives it for the output of a program
    assert files_in(tmp_path / "pipe.csv") == [tmp_path / "pipe.csv"]


@pytest.mark.parametrize("left", ["2026-11-05 11:0", "2026-11-05 11:02:00,4", "2026"])
def test_a_file_copied_while_it_was_written_lacks_its_last_row(left: str, write: Write) -> None:
    rows = "".join(f"2026-11-05 11:{s // 60:02}:{s % 60:02},{s},{-s}\n" for s in range(0, 120, 2))
    found = read_recording(write(f"time,op,pv\n{rows}{left}"))
    assert len(found) == 60
    assert found.notes[0] == "the header is line 1; line without samples: 62"
    assert found.op[-1] == 118.0


def test_an_index_of_elapsed_times_without_a_name_is_the_time(write: Write) -> None:
    def row(k: int) -> str:
        hours, rest = divmod(1800 * k, 3600)
        return f"{hours // 24} days {hours % 24:02}:{rest // 60:02}:00,{k},{-k}"

    found = read_recording(write(",op,pv", row))
    assert found.period == 1800.0
    assert found.notes == (
        "the column without a heading holds dates or times of day: taken for the time",
    )


def test_a_site_file_is_no_recording() -> None:
    said = messages(ROOT / "site_configs" / "demo.toml")
    assert said.startswith(" is a TOML file, not a recording; name a recording")


def test_a_packed_file_is_to_be_unpacked(write: Write) -> None:
    text = ("op,pv\n" + "1,2\n" * 60).encode()
    for packed, name in ((gzip.compress(text), "gzip"), (lzma.compress(text), "xz")):
        assert messages(write(packed)) == f" is packed ({name}); unpack it first"
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("loop.csv", text)
    said = messages(write(archive.getvalue()))
    assert said == " is a ZIP file and no workbook; unpack it first"


@pytest.mark.parametrize("bad", ["-9999", "-999", "32767", "4294967295", "99999.0"])
def test_numbers_that_stand_for_no_value_are_bad_samples(write: Write, bad: str) -> None:
    found = read_recording(
        write("op,pv", lambda k: f"{bad},{bad}" if k in (7, 8) else f"{50 + k / 9:.3f},{20 - k}")
    )
    assert np.flatnonzero(np.isnan(found.op)).tolist() == [7, 8]
    assert np.flatnonzero(np.isnan(found.pv)).tolist() == [7, 8]
    assert any(f"{float(bad):.10g} at 2 rows" in note for note in found.notes)


def test_such_a_number_among_its_like_is_a_measurement(write: Write) -> None:
    counts = read_recording(write("op,pv", lambda k: f"{25000 + 200 * k},{999 if k == 5 else 900}"))
    assert not np.isnan(counts.op).any()
    assert not np.isnan(counts.pv).any()
    top = read_recording(write("op,pv", lambda k: f"{min(32767, 30000 + 100 * k)},{9999 - k}"))
    assert not np.isnan(top.op).any()
    assert not np.isnan(top.pv).any()


def test_a_set_point_of_999_is_one_where_pv_follows_it(write: Write) -> None:
    def step(k: int) -> str:
        return f"{50 + k / 9:.3f},{100.5 if k < 20 else 998.5},{100 if k < 20 else 999}"

    found = read_recording(write("op,pv,sp", step))
    assert found.sp is not None
    assert found.sp[[0, -1]].tolist() == [100.0, 999.0]
    lost = read_recording(write("op,pv,sp", lambda k: f"{k % 7},{50 + k % 5},{-999 if k else 50}"))
    assert lost.sp is not None
    assert np.isnan(lost.sp[1:]).all()


@pytest.mark.parametrize("header", ["op,pv,x", "FC1.OUT,FC1.PV,FC2.OUT", "FC1.OP,FC1.PV,FC2.PV"])
def test_columns_that_were_named_the_wrong_way_round_get_a_note(header: str, write: Write) -> None:
    """Such a record is judged without an error: as a healthy valve, mostly."""
    path = write(f"{header}\n" + "".join(f"{k % 7},{k % 5},{k % 3}\n" for k in range(60)))
    op, pv, _ = header.split(",")
    wrong = read_recording(path, op=pv, pv=op).notes
    assert any("by their names they are exchanged" in note for note in wrong)
    right = read_recording(path, op=op, pv=pv).notes
    assert not any("exchanged" in note for note in right)


def test_an_op_from_0_to_1_says_what_s_and_j_are_then(write: Write) -> None:
    """The work list has them in % of OP's span; the sentence may not contradict it."""
    note = "S and J in its units are shares of its range, 0.04 is 4 %"
    shares = read_recording(write("op,pv", lambda k: f"{(k % 11) / 10},{k % 5}")).notes
    assert any(note in one for one in shares)
    percent = read_recording(write("op,pv", lambda k: f"{k % 11},{k % 5}")).notes
    assert not any(note in one for one in percent)
