"""Rows that a logger left out: bad samples where they are few, a cut where they are many."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fieldlink.site.missing_rows import LONGEST_FILLED, fill_missing_rows
from fieldlink.site.recording import Recording, read_recording


def _recorded(tmp_path: Path, seconds: np.ndarray) -> Recording:
    path = tmp_path / "loop.csv"
    rows = [f"{t:.3f},{t:.3f},{-t:.3f},1" for t in seconds]
    path.write_text("\n".join(["time,op,pv,auto", *rows]))
    return read_recording(path)


def test_missing_rows_become_bad_samples(tmp_path: Path) -> None:
    seconds = np.delete(np.arange(0.0, 240.0, 2.0), [10, 50, 51, 52])
    recorded = _recorded(tmp_path, seconds)
    filled = fill_missing_rows(recorded)
    assert len(filled) == 120
    assert np.flatnonzero(np.isnan(filled.op)).tolist() == [10, 50, 51, 52]
    # every value stands where its time says
    good = ~np.isnan(filled.pv)
    np.testing.assert_allclose(filled.op[good], 2.0 * np.flatnonzero(good))
    np.testing.assert_allclose(filled.pv[good], -filled.op[good])
    assert filled.time is not None
    np.testing.assert_allclose(filled.time, np.arange(0.0, 240.0, 2.0))
    assert filled.auto is not None
    assert filled.auto.all()
    assert filled.notes[-1] == "4 missing rows are taken for bad samples"


def test_late_stamps_are_no_missing_rows(tmp_path: Path) -> None:
    seconds = np.arange(0.0, 100.0)
    seconds[20:60:3] += 0.9
    recorded = _recorded(tmp_path, seconds)
    assert recorded.irregular > 0
    assert fill_missing_rows(recorded) is recorded


def test_a_regular_recording_stays_as_it_is(tmp_path: Path) -> None:
    recorded = _recorded(tmp_path, np.arange(0.0, 100.0))
    assert fill_missing_rows(recorded) is recorded


@pytest.mark.parametrize(("gap", "rows"), [(LONGEST_FILLED, 130), (LONGEST_FILLED + 1, 60)])
def test_a_long_gap_leaves_the_longest_part(gap: int, rows: int, tmp_path: Path) -> None:
    seconds = np.concatenate([np.arange(40.0), 40.0 + gap + np.arange(60.0)])
    filled = fill_missing_rows(_recorded(tmp_path, seconds))
    assert len(filled) == rows
    if rows == 60:
        assert filled.op[0] == 40.0 + gap
        assert "rows 41 to 100 of 100 are used" in filled.notes[-1]
        assert f"{gap + 1:g} s" in filled.notes[-1]
        assert "file of its own" in filled.notes[-1]


def test_a_given_period_that_contradicts_the_clock_counts(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    seconds = np.delete(np.arange(0.0, 240.0, 2.0), 10)
    path.write_text("\n".join(["time,op,pv", *(f"{t},{t},{t}" for t in seconds)]))
    recorded = read_recording(path, period=10.0)
    assert fill_missing_rows(recorded) is recorded


@pytest.mark.parametrize("seed", range(5))
def test_rows_of_changes_only_stand_where_their_time_says(tmp_path: Path, seed: int) -> None:
    """A historian that leaves out every other row: the median interval is no period."""
    rng = np.random.default_rng(seed)
    slots = np.sort(rng.choice(np.arange(1, 899), 450, replace=False))
    slots = np.concatenate([[0], slots, [899]])
    recorded = _recorded(tmp_path, 2.0 * slots)
    assert recorded.period == 2.0
    filled = fill_missing_rows(recorded)
    assert len(filled) == 900
    assert np.flatnonzero(~np.isnan(filled.op)).tolist() == slots.tolist()


def test_stamps_in_whole_seconds_are_no_missing_rows(tmp_path: Path) -> None:
    """A row each 1.5 s with stamps cut off: intervals of one and two seconds in turn."""
    recorded = _recorded(tmp_path, np.floor(1.5 * np.arange(121)))
    assert recorded.period == pytest.approx(1.5)
    assert len(fill_missing_rows(recorded)) == 121


@pytest.mark.parametrize("seed", range(3))
def test_rows_of_changes_with_fine_stamps_have_no_period_of_their_shortest_interval(
    tmp_path: Path, seed: int
) -> None:
    """Intervals without memory, a median of 3.5 s, stamps of 0.01 s."""
    gaps = np.random.default_rng(seed).exponential(5.0, 899)
    recorded = _recorded(tmp_path, np.round(np.cumsum(np.maximum(gaps, 0.01)), 2))
    assert recorded.period == pytest.approx(5.0 * np.log(2.0), rel=0.1)
    assert "sampling is irregular" in recorded.notes[0]
