"""The short version of `benchmarks.kills`: a few kills, the same demands."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from benchmarks import kills


@pytest.mark.slow
def test_a_daemon_that_is_killed_loses_nothing_that_was_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A block comes when a window is judged, however long a busy machine takes for that.
    monkeypatch.setattr(kills, "PATIENCE", 500.0)
    tally = asyncio.run(kills.run_kills(2, seed=3, folder=tmp_path))
    assert tally.runs == 2
    assert tally.rows > 40
    assert (tally.lost, tally.damaged, tally.faults) == (0, 0, [])
    assert (tally.after_bank, tally.after_commit) == (1, 1)
    # What was committed before the kill is taken by the PLC after it.
    assert tally.accepted >= 1
    assert (tally.unrecorded, tally.incomplete) == (0, 0)
