"""Rows whose clock was set back are not mixed; times beside every signal are those of the row."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fieldlink.site import read_recording
from fieldlink.site.missing_rows import fill_missing_rows
from fieldlink.site.recording import RecordingError

N = 240
START = datetime(2026, 3, 4, 10, tzinfo=UTC)


def stamp(seconds: float) -> str:
    return f"{START + timedelta(seconds=seconds):%Y-%m-%d %H:%M:%S}"


def write(folder: Path, rows: list[str], head: str = "time,op,pv") -> Path:
    path = folder / "loop.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("back", [603.0, 600.0, 605.0, 47.0])
def test_a_clock_that_was_set_back_is_refused_with_the_place(back: float, tmp_path: Path) -> None:
    rows = [f"{stamp(10 * k - back * (k >= 100))},{k},{-k}" for k in range(N)]
    with pytest.raises(
        RecordingError, match=rf":102: time: the clock goes back by {back - 10:g} s"
    ):
        read_recording(write(tmp_path, rows))
    recording = read_recording(write(tmp_path, rows), period=10.0)
    assert recording.op.tolist() == list(range(N))
    assert any("the clock goes back" in note for note in recording.notes)


@pytest.mark.parametrize("overlap", [0, 1, 30])
def test_blocks_of_one_clock_are_still_sorted(overlap: int, tmp_path: Path) -> None:
    rows = [f"{stamp(10 * k)},{k},{-k}" for k in range(N)]
    recording = read_recording(write(tmp_path, rows[120 - overlap :] + rows[:120]))
    assert recording.op.tolist() == list(range(N))
    assert recording.period == pytest.approx(10.0)


def test_the_same_times_before_every_signal_are_one_column(tmp_path: Path) -> None:
    rows = [f"{stamp(10 * k)},{k},{stamp(10 * k)},{-k}" for k in range(N)]
    recording = read_recording(write(tmp_path, rows, "Timestamp,FC1.OP,Timestamp,FC1.PV"))
    assert (recording.period, recording.pv[1]) == (10.0, -1.0)
    assert "2 columns hold the same times: the first one is taken" in recording.notes


@pytest.mark.parametrize("heading", ["Timestamp", "Time"])
def test_signals_with_times_of_their_own_are_refused(heading: str, tmp_path: Path) -> None:
    rows = [f"{stamp(10 * k)},{k},{stamp(10 * k + 3)},{-k}" for k in range(N)]
    with pytest.raises(RecordingError, match="export all signals at the same moments"):
        read_recording(write(tmp_path, rows, f"{heading},FC1.OP,{heading},FC1.PV"))


@pytest.mark.parametrize("missing", [0, 4])
@pytest.mark.parametrize("period", [0.5, 0.7, 1.2, 1.5, 1.7, 2.5, 3.3, 7.3])
def test_stamps_of_whole_seconds_of_samples_between_them(
    period: float, missing: int, tmp_path: Path
) -> None:
    rows = [f"{stamp(period * k)},{k},{-k}" for k in range(N)]
    recording = fill_missing_rows(
        read_recording(write(tmp_path, rows[:100] + rows[100 + missing :]))
    )
    # Over a gap the samples are counted to a count of the clock.
    late = 0 if period > 1.0 or not missing else 2
    assert recording.period == pytest.approx(period, rel=1e-2 if late else 1e-3)
    assert len(recording) == pytest.approx(N, abs=late)
    assert int(np.isnan(recording.op).sum()) == pytest.approx(missing, abs=late)
    assert any("the clock counts in steps of 1 s" in note for note in recording.notes)


def test_rows_that_are_missing_by_chance_are_no_coarse_clock(tmp_path: Path) -> None:
    kept = np.random.default_rng(2).random(N) < 0.85
    kept[[0, N - 1]] = True
    rows = [f"{stamp(k)},{k},{-k}" for k in range(N) if kept[k]]
    recording = fill_missing_rows(read_recording(write(tmp_path, rows)))
    assert recording.period == 1.0
    assert len(recording) == N


@pytest.mark.parametrize("times", [2, 3])
def test_every_row_several_times_is_a_row(times: int, tmp_path: Path) -> None:
    rows = [f"{stamp(10 * k)},{k},{-k}" for k in range(N) for _ in range(times)]
    recording = read_recording(write(tmp_path, rows))
    assert recording.op.tolist() == list(range(N))
    assert recording.period == 10.0


def test_days_kept_as_moments_stand_beside_their_times(tmp_path: Path) -> None:
    moments = [START.replace(tzinfo=None) + timedelta(seconds=600 * k) for k in range(N)]
    table = pd.DataFrame(
        {
            "Date": [m.date() for m in moments],
            "Time": [m.time() for m in moments],
            "op": range(N),
            "pv": range(N),
        }
    )
    table.to_excel(tmp_path / "loop.xlsx", index=False)
    recording = read_recording(tmp_path / "loop.xlsx")
    assert recording.start == START.timestamp()
    assert recording.period == 600.0
