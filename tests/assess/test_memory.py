"""What a worker may hold: files of one folder do not take it from each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fieldlink.assess import Columns, Cut, Job, Judging
from fieldlink.assess.places import place_of
from fieldlink.assess.workers.watched import WatchedWorker


@pytest.mark.thorough
def test_a_parquet_file_takes_no_memory_from_the_files_after_it(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(size=(300_000, 2))
    table = pa.table({"op": noise[:60, 0], "pv": noise[:60, 1]})
    pq.write_table(table, tmp_path / "A.parquet")
    text = "\n".join(["op,pv", *(f"{op!r},{pv!r}" for op, pv in noise.tolist())])
    (tmp_path / "B.csv").write_text(text)
    # Reading B takes some 200 MB, a worker with its libraries 300; Arrow's allocator would have
    # reserved 1,070.
    judging = Judging(memory=1_400_000_000)
    job = Job((place_of(str(tmp_path)),), Columns(period=1.0), Cut(every=1e9), judging)
    worker = WatchedWorker(job)
    try:
        pieces = list(worker.list_pieces(0))
        rows = [row for piece in pieces for row in worker.judge(piece)]
    finally:
        worker.close()
    assert [(row["loop"], row["error"]) for row in rows] == [("A", None), ("B", None)]


@pytest.mark.thorough
def test_a_parquet_file_that_is_too_large_is_said_to_be(tmp_path: Path) -> None:
    # Sixteen bytes a row in memory: three times what the worker may hold.
    batch = pa.record_batch({"op": np.zeros(1_000_000), "pv": np.zeros(1_000_000)})
    with pq.ParquetWriter(tmp_path / "A.parquet", batch.schema) as writer:
        for _ in range(100):
            writer.write_batch(batch)
    worker = WatchedWorker(Job((place_of(str(tmp_path)),), judging=Judging(memory=500_000_000)))
    try:
        (piece,) = worker.list_pieces(0)
        (row,) = worker.judge(piece)
    finally:
        worker.close()
    assert "needs more memory than a worker may use" in row["error"]
