"""A history that is stored a file a day is one loop's: what joins its files, and what does not."""

from __future__ import annotations

import json
import re
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from fieldlink.assess.assessment import _finish
from fieldlink.assess.histories import history_of, named_by_file
from fieldlink.assess.job import Job, Piece, Place
from fieldlink.assess.run_file import Counts, RunFile
from fieldlink.assess.table_row import KEPT
from tests.assess.test_command import table
from tests.cli.typed import run_typed

START = "2026-01-05T00:00:00Z"


@pytest.mark.parametrize(
    ("file", "other", "loop"),
    [
        ("FC101_2026-01-05.csv", "FC101_2026-01-06.csv", "FC101"),
        ("2026-01-05/FC101.csv", "2026-01-06/FC101.csv", "FC101"),
        ("2026/01/05/FC101.csv", "2026/01/06/FC101.csv", "FC101"),
        ("2026/01/FC101.csv", "2025/12/FC101.csv", "FC101"),
        ("FC101/20260105.csv", "FC101/20260106.csv", "FC101"),
        ("05.01.2026_FC101.csv", "17.12.2025_FC101.csv", "FC101"),
        ("FC101_20260105_080000.csv", "FC101_20260105_160000.csv", "FC101"),
        ("FC101-2026-01-05T08-00Z.csv", "FC101-2026-01-05T16-00Z.csv", "FC101"),
        ("FC101_2026010508.csv", "FC101_2026010516.csv", "FC101"),
        (
            "loop=FC1/date=2026-01-05/part-0.parquet",
            "loop=FC1/date=2026-01-06/part-3.parquet",
            "FC1",
        ),
        ("year=2026/month=1/FC1.parquet", "year=2026/month=2/FC1.parquet", "FC1"),
    ],
)
def test_a_date_in_a_path_tells_no_loops_apart(file: str, other: str, loop: str) -> None:
    start = datetime.fromisoformat(START).timestamp()
    assert history_of(f"h/{file}", START) == history_of(f"h/{other}", START)
    assert named_by_file(Path("/h", file), start) == named_by_file(Path("/h", other), start) == loop


@pytest.mark.parametrize(
    ("file", "other"),
    [
        ("FIC-2001-05.csv", "FIC-2001-06.csv"),
        ("FIC-2001-05-01.csv", "FIC-2001-05-02.csv"),
        ("FIC-2025.csv", "FIC-2026.csv"),
        ("FC101.csv", "FC102.csv"),
        ("2026-01-05/FC101.csv", "2026-01-05/FC102.csv"),
        ("20260105_12.csv", "20260105_13.csv"),
        ("area 1/FC101.csv", "area 2/FC101.csv"),
        ("stream=A/all.parquet", "stream=B/all.parquet"),
        ("speed=3/FC101.csv", "speed=5/FC101.csv"),
        ("m=north/FC101.csv", "m=south/FC101.csv"),
        ("part-1_boiler.csv", "part-1_drum.csv"),
    ],
)
def test_what_may_be_a_tag_tells_loops_apart(file: str, other: str) -> None:
    assert history_of(f"h/{file}", START) != history_of(f"h/{other}", START)


def test_a_recording_without_dates_keeps_its_name() -> None:
    assert history_of("h/FC101_2026-01-05.csv", None) == "h/FC101_2026-01-05.csv"
    assert named_by_file(Path("/h/FC101_2026-01-05.csv"), None) == "FC101_2026-01-05"


def test_a_file_a_day_is_one_loop_in_the_order_of_time(tmp_path: Path, sticky) -> None:
    # Day first: by their names the files are in another order.
    for day in ("30-01-2026", "31-01-2026", "01-02-2026"):
        begin = datetime.strptime(day, "%d-%m-%Y").replace(tzinfo=UTC).timestamp()
        rows = np.column_stack([begin + 2.0 * np.arange(120), sticky.op[:120], sticky.pv[:120]])
        file = tmp_path / "days" / f"FC101 {day}.csv"
        file.parent.mkdir(exist_ok=True)
        np.savetxt(file, rows, delimiter=",", header="time,op,pv", comments="")
    done = run_typed(tmp_path, "assess", "days", "--out", "out", "--workers", 1)
    assert "1 loop, 3 rows" in done.stdout
    rows = table(tmp_path / "out")
    assert {row["loop"] for row in rows} == {"FC101"}
    assert [row["start"][:10] for row in rows] == ["2026-01-30", "2026-01-31", "2026-02-01"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "and 2 more files" in page
    assert "2026-01-30 to 2026-02-01" in page


def window(loop: str, day: int, sticks: bool, band: float) -> dict[str, object]:
    return dict.fromkeys(KEPT) | {
        "file": "history.parquet",
        "loop": loop,
        "start": f"2026-01-{day + 1:02}T00:00:00Z",
        "verdict": "stiction" if sticks else "no_stiction",
        "score": 50.0 if sticks else -5.0,
        "stick_band": band,
        "stick_band_low": band,
        "stick_band_high": band,
        "cause": "sticky_valve" if sticks else "quiet",
        "action": "Check the packing." if sticks else "Nothing to do.",
    }


@pytest.mark.parametrize(
    ("files", "loops"),
    [
        # Tags with numbers like dates, all recorded at the same time.
        ({"FC-20260101.csv": 1, "FC-20260102.csv": 1, "FC-20260103.csv": 1}, 3),
        # Files a day, and one of these days exported twice.
        ({"FC_2026-01-01.csv": 1, "FC_2026-01-02.csv": 2, "FC_20260102.csv": 2}, 1),
    ],
)
def test_files_of_the_same_time_are_different_loops(
    tmp_path: Path, files: dict[str, int], loops: int
) -> None:
    with closing(RunFile(tmp_path / "run.sqlite")) as run_file:
        run_file.plan([Piece(number, file) for number, file in enumerate(files)])
        for number, (file, day) in enumerate(files.items(), start=1):
            times = [f"2026-01-0{day}T{hour:02}:00:00Z" for hour in range(24)]
            rows = [
                window("FC", day, True, 1.0)
                | {"file": file, "start": start, "samples": 1000, "period_s": 3.6}
                for start in times
            ]
            run_file.store([(number, rows)])
        run_file.rank()
        assert len(run_file.ranked_loops(10)) == loops
        assert len(list(run_file.ranked_rows())) == 24 * len(files)


def test_valves_that_stick_now_come_before_one_that_was_repaired(tmp_path: Path) -> None:
    courses = {
        "repaired": "SSSSSSSSSSSSHHH",
        "sticks": "HHHSSSSSSSSSSSH",
        "begins": "HHHHHHHHHHHHSSS",
        "rarely": "HHHSHHHHHHHHHSH",
        "healthy": "HHHHHHHHHHHHHHH",
    }
    job = Job((Place("files", "history", "history"),))
    with closing(RunFile(tmp_path / "run.sqlite")) as run_file:
        run_file.plan([Piece(0, "history.parquet")])
        rows = [
            window(loop, day, letter == "S", 1.0 + day)
            for loop, course in courses.items()
            for day, letter in enumerate(course)
        ]
        run_file.store([(1, rows)])
        outcome = _finish(job, run_file, tmp_path, 0.0, Counts(1, 0, 0, 0))
        classes = run_file.classes()
    assert outcome.loops == 5
    ranked = list(dict.fromkeys(row["loop"] for row in table(tmp_path)))
    assert ranked == ["sticks", "begins", "rarely", "repaired", "healthy"]
    assert classes == {0: 2, 1: 1, 2: 1, 3: 1}
    assert json.loads((tmp_path / "run.json").read_text())["loops"] == 5
    page = (tmp_path / "report.html").read_text()
    lines = {loop: page.partition(f">{loop}<br>")[2].partition("</tr>")[0] for loop in courses}
    # Its band grew until the repair: that says nothing of the valve as it is.
    slope = re.compile(r'<td class="n">\+30 ')
    assert slope.search(lines["sticks"])
    assert not slope.search(lines["repaired"])
    assert "on 2026-01-12" in lines["repaired"]
