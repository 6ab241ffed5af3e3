"""Sticky valves whose friction is another one at every slip."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.uneven_friction import draw, main


def test_a_stem_slips_by_frictions_that_differ_as_told() -> None:
    """Static friction is OP's distance from the stem before a slip, dynamic friction after it."""
    loops = [loop for loop in map(draw, range(1000, 1040)) if loop is not None]
    assert len(loops) >= 25
    seen = 0
    for loop in loops:
        rows = np.flatnonzero(np.diff(loop.stem)) + 1
        if loop.slides or rows.size < 12:
            continue
        static = np.abs(loop.op[rows] - loop.stem[rows - 1])
        dynamic = np.abs(loop.op[rows] - loop.stem[rows])
        # a scan passes the static friction by what OP moves in it
        assert np.median(static + dynamic) == pytest.approx(loop.stick_band, rel=0.3)
        assert np.std(dynamic) / np.mean(dynamic) == pytest.approx(loop.spread, rel=0.8, abs=0.05)
        seen += 1
    assert seen >= 5


def test_the_table_has_a_line_for_every_kind_and_their_sum(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--first", "1000", "--loops", "2"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    counts = [[int(cell) for cell in line.split("|")[2:7]] for line in lines[1:]]
    assert len(counts) == 5
    assert counts[-1] == [sum(column) for column in zip(*counts[:-1], strict=True)]
    assert all(row[0] == sum(row[1:]) for row in counts)
