"""Rows whose clock was set back are not mixed; times beside every signal are those of the row."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fieldlink.site import read_recording
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
