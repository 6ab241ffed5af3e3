"""A bound on what is read costs no memory, and holds for what has no size of its own."""

from __future__ import annotations

import os
import threading
import tracemalloc
from pathlib import Path

import pytest

from fieldlink.site.bounded_file import MEGABYTE, UnreadableFileError, read_bytes


def test_a_small_file_takes_the_memory_of_a_small_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"op,pv\n")
    tracemalloc.start()
    try:
        assert read_bytes(tmp_path / "a.csv", most_megabytes=1000) == b"op,pv\n"
        assert tracemalloc.get_traced_memory()[1] < 100 * MEGABYTE
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("size", [MEGABYTE, MEGABYTE + 1])
def test_the_bound_holds_for_a_pipe_too(tmp_path: Path, size: int) -> None:
    os.mkfifo(tmp_path / "pipe")

    def write() -> None:
        with (tmp_path / "pipe").open("wb") as stream:
            stream.write(b"x" * size)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    if size > MEGABYTE:
        with pytest.raises(UnreadableFileError, match="is larger than 1 MB"):
            read_bytes(tmp_path / "pipe", most_megabytes=1, pipe=True)
    else:
        assert len(read_bytes(tmp_path / "pipe", most_megabytes=1, pipe=True)) == size
    writer.join(10.0)
