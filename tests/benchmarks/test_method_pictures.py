"""The pictures of docs/method.md can be drawn."""

from __future__ import annotations

import pytest

from benchmarks import method_pictures
from benchmarks.method_pictures import main


@pytest.mark.thorough
def test_pictures_are_drawn(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(method_pictures, "_WEEKS", 5)
    monkeypatch.setattr(method_pictures, "_REPAIRED", 3)
    assert main(["--images", str(tmp_path / "new")]) == 0
    for name in ("valve.png", "likelihood.png", "valve-course.png"):
        assert (tmp_path / "new" / name).read_bytes().startswith(b"\x89PNG")
