"""Loops under a triangular load whose period wanders."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.wandering_loads import ENTRIES, draw, main


def test_the_load_moves_op_as_often_as_it_swings() -> None:
    """A controller answers a load: its spectrum has the load's line at the load's frequency."""
    loops = [loop for loop in map(draw, range(3000, 3012)) if loop is not None]
    assert len(loops) >= 10
    assert {loop.entry for loop in loops} <= set(ENTRIES)
    for loop in loops:
        size = np.abs(np.fft.rfft(loop.op - loop.op.mean()))
        slow = max(1, round(0.5 * loop.cycles))
        peak = slow + int(size[slow:].argmax())
        assert peak == pytest.approx(loop.cycles, abs=1.0 + 0.15 * loop.cycles)
        assert loop.op.size == loop.pv.size


def test_the_table_has_a_line_for_every_entry_and_their_sum(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--first", "3000", "--loops", "2"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert [line.split("|")[1].strip() for line in lines[1:]] == [*ENTRIES, "all"]
    counts = [[int(cell) for cell in line.split("|")[2:-1]] for line in lines[1:]]
    assert counts[-1] == [sum(column) for column in zip(*counts[:-1], strict=True)]
