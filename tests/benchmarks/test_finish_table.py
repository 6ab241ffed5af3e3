"""The rows that the fleet's benchmark makes up are rows that a run stores."""

from __future__ import annotations

from pathlib import Path

from benchmarks.finish_table import finish


def test_made_up_rows_are_stored_and_make_tables_and_a_page(tmp_path: Path) -> None:
    figures = finish(200, tmp_path)
    assert figures["rows"] == 200
    lines = (tmp_path / "loops.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 200
    assert (tmp_path / "report.html").stat().st_size > 1000
