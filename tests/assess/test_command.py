"""``fieldlink assess`` as a user runs it: the contract, resumption, refusals."""

from __future__ import annotations

import csv
import json
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
import pyarrow.parquet as pq
import pytest

from estimator import identify
from fieldlink.assess import AssessError
from fieldlink.assess.run_file import RunFile
from tests.assess.conftest import UNREHEARSED
from tests.cli.typed import run_typed

CONTRACT = (
    "file,loop,start,samples,period_s,verdict,score,stick_band,stick_band_low,"
    "stick_band_high,slip_jump,cause,action,seconds,error"
)
KILLED = f"""
import os, signal, sys
from fieldlink.assess.workers import watched
from fieldlink.cli import main

watched.PROCESS = {UNREHEARSED!r}

def end(text):
    # The first line of progress comes after the first batch is stored.
    if " of 8 read" in text:
        os.kill(os.getpid(), signal.SIGKILL)
    return len(text)

sys.stderr.write = end
main()
"""
"""A program that is killed by itself: from outside the moment would hang on the machine."""


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "loops.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def figures(folder: Path) -> list[dict[str, str]]:
    """The table without what a clock decides."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in table(folder)]


def test_a_folder_becomes_a_ranked_table_and_a_poisoned_file_costs_one_row(
    judged: Path, sticky
) -> None:
    folder, out = judged, judged / "out"
    rows = table(out)
    assert ",".join(rows[0]) == CONTRACT
    assert rows[0]["loop"] == "FC101"
    assert {row["loop"] for row in rows} == {"FC101", "TC202", "LC203", ""}
    first, last = rows[0], rows[-1]
    truth = identify(sticky.op, sticky.pv)
    assert first["verdict"] == truth.verdict == "stiction"
    assert float(first["stick_band"]) == truth.stick_band.value
    assert float(first["score"]) == truth.score
    assert (first["cause"], first["start"], first["samples"]) == ("sticky_valve", "0", "400")
    assert Path(last["file"]) == folder / "PC104.csv"
    assert last["error"] == (
        "line 62: pv: 'off' is not a number; correct it, or leave the cell empty where the sample "
        "is bad"
    )
    assert last["verdict"] == ""
    parquet = pq.read_table(out / "loops.parquet")
    assert ",".join(parquet.column_names) == CONTRACT
    assert parquet["score"].to_pylist() == [
        float(row["score"]) if row["score"] else None for row in rows
    ]
    page = (out / "report.html").read_text()
    assert "FC101" in page
    assert "is not a number" in page
    assert not (out / "run.sqlite").exists()


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_and_ends_with_the_same_table(
    tmp_path: Path, sticky, healthy
) -> None:
    loops = tmp_path / "loops"
    loops.mkdir()
    for number in range(8):
        loop = (sticky, healthy)[number % 2]
        rows = np.column_stack([loop.op, loop.pv])[: 120 + 20 * number]
        np.savetxt(loops / f"L{number:02}.csv", rows, delimiter=",", header="op,pv", comments="")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    run = partial(run_typed, tmp_path, "assess", loops)
    assert run("--out", whole, "--workers", 1).returncode == 0
    command = [sys.executable, "-c", KILLED, "assess", str(loops), "--out", str(broken)]
    begun = subprocess.run([*command, "--workers", "1"], check=False)
    assert begun.returncode == -signal.SIGKILL
    kept = sqlite3.connect(broken / "run.sqlite")
    done = kept.execute("SELECT COUNT(*) FROM pieces WHERE done").fetchone()[0]
    kept.close()
    assert 1 <= done < 8
    other = run("--out", broken, "--samples", 500)
    assert other.returncode == 2
    assert "holds a run with another value of samples (1000)" in other.stderr
    again = run("--out", broken, "--workers", 1)
    assert again.returncode == 0, again.stderr
    assert f"{8 - done} judged" in again.stdout
    assert figures(broken) == figures(whole)
    assert json.loads((broken / "run.json").read_text())["rows"] == 8
    finished = run("--out", broken)
    assert finished.returncode == 0
    assert "was finished before" in finished.stdout


def write_days(folder: Path, days: int) -> None:
    """A loop at rest, a file a day from 2026-01-01 on."""
    folder.mkdir()
    for day in range(1, days + 1):
        lines = [f"2026-01-{day:02} 00:{k // 60:02}:{k % 60:02},50,{k % 7}" for k in range(120)]
        text = "\n".join(["time,op,pv", *lines])
        (folder / f"FC101_2026-01-{day:02}.csv").write_text(text)


def test_files_outside_of_the_time_that_was_asked_for_are_no_errors(tmp_path: Path) -> None:
    write_days(tmp_path / "days", 4)
    run = partial(run_typed, tmp_path, "assess", "days", "--workers", 1, "--out", "out")
    done = run("--since", "2026-01-02", "--until", "2026-01-03T00:00Z")
    assert done.returncode == 0, done.stdout
    assert [row["start"] for row in table(tmp_path / "out")] == ["2026-01-02T00:00:00Z"]
    assert "nothing between --since and --until: 3 files" in done.stdout
    other = run("--since", "2026-01-03")
    assert other.returncode == 2
    assert "another value of since (2026-01-02T00:00:00Z)" in other.stderr


def test_a_run_that_read_nothing_may_be_begun_with_other_options(tmp_path: Path) -> None:
    write_days(tmp_path / "days", 1)
    run = partial(run_typed, tmp_path, "assess", "days", "--out", "out", "--workers", 1)
    with mock.patch("fieldlink.assess.assessment._engine", side_effect=AssessError("no scheduler")):
        assert "no scheduler" in run("--samples", 60).stderr
    done = run("--samples", 120)
    assert done.returncode == 0, done.stderr
    assert [row["samples"] for row in table(tmp_path / "out")] == ["120"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.csv"], "there is no file or folder missing.csv"),
        ([".", "--every", "soon"], "is not a length of time"),
        ([".", "--engine", "cloud"], "write local or dask"),
        ([".", "--out", "taken"], "holds loops.csv of something else"),
        ([".", "--scheduler", "10.0.0.5"], "write one such as tcp://10.0.0.5:8786"),
        (["days", "days/FC101_2026-01-01.csv"], "is given twice, also by days"),
        (["days", "./days/"], "is given twice, also by"),
        ([".", "--out", "."], ". is what is read; name a folder of its own"),
        (["days", "--since", "2026-02-01"], "days: no samples between --since and --until"),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_sentence(
    tmp_path: Path, arguments: list[str], words: str
) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "loops.csv").write_text("a,b\n")
    write_days(tmp_path / "days", 1)
    done = run_typed(tmp_path, "assess", *arguments)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.replace("│", " ").split())


def test_how_a_file_was_read_stands_beside_the_table(tmp_path: Path, sticky) -> None:
    with (tmp_path / "newest.csv").open("w") as stream:
        stream.write("time,op,pv\n")
        for k in reversed(range(400)):
            stream.write(f"{1.79e9 + 2 * k:.0f},{float(sticky.op[k])!r},{float(sticky.pv[k])!r}\n")
    out = tmp_path / "out"
    done = run_typed(tmp_path, "assess", "newest.csv", "--out", out, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert table(out)[0]["verdict"] == "stiction"
    with (out / "notes.csv").open(newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert list(row) == ["file", "loop", "notes"]
    assert "newest first: turned round" in row["notes"]


def test_a_run_of_an_older_release_gets_the_columns_it_lacks(tmp_path: Path) -> None:
    file = tmp_path / "run.sqlite"
    columns = ", ".join(CONTRACT.split(","))
    with closing(sqlite3.connect(file)) as database:
        database.execute(
            f"CREATE TABLE windows (piece INTEGER NOT NULL, number INTEGER NOT NULL, {columns}, "
            "PRIMARY KEY (piece, number)) WITHOUT ROWID"
        )
        database.execute("INSERT INTO windows (piece, number, file, loop) VALUES (1, 0, 'a', 'A')")
        database.commit()
    run_file = RunFile(file)
    run_file.store([(2, [dict.fromkeys(CONTRACT.split(",")) | {"loop": "B", "notes": "turned"}])])
    run_file.rank()
    rows = [*run_file.windows_of("a", "A", 9)]
    assert [(row["loop"], row["notes"]) for row in rows] == [("A", None)]
    assert run_file.counts().rows == 2
    run_file.close()
