"""No loop has two writers: the second is refused, a dead one is replaced, nothing interleaves."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.store import read_samples
from tests.store.writers import (
    QUICK,
    begin,
    killed_is_replaced,
    sample,
    second_is_refused,
    sleeper_waits,
    wait_until,
    writer,
)


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path}/history.sqlite"


@pytest.mark.parametrize("check", [second_is_refused, sleeper_waits, killed_is_replaced])
def test_no_loop_has_two_writers(
    check: Callable[[str, Path], None], url: str, tmp_path: Path
) -> None:
    check(url, tmp_path)


def test_writers_of_different_loops_share_a_historian(url: str, tmp_path: Path) -> None:
    first = begin(url, writer(tmp_path / "a", "FC101"))
    second = begin(url, writer(tmp_path / "b", "LC3", identity=8))
    for slot in range(50):
        first.put(sample(slot), wait=True)
        second.put(sample(slot, "LC3"), wait=True)
    assert second.stop().dropped == first.stop().dropped == 0
    assert len(read_samples(url, "FC101")) == len(read_samples(url, "LC3")) == 50


def test_one_that_stopped_leaves_its_loops_to_the_next(url: str, tmp_path: Path) -> None:
    begin(url, writer(tmp_path / "a", "FC101")).stop()
    began = time.monotonic()
    begin(url, writer(tmp_path / "b", "FC101", identity=8)).stop()
    assert time.monotonic() - began < QUICK.expires


def test_loops_that_come_with_a_reload_are_claimed_too(url: str, tmp_path: Path) -> None:
    first = begin(url, writer(tmp_path / "a", "FC101"))
    second = begin(url, writer(tmp_path / "b", "LC3", identity=8))
    second.follow(["LC3", "FC101"])
    second.put(sample(1, "LC3"))
    wait_until(lambda: "loop FC101 " in second.report().last_error)
    second.follow(["LC3"])
    wait_until(lambda: not second.report().failing)
    assert second.stop().dropped == 0
    assert first.report().failing is False
    first.stop()
    assert len(read_samples(url, "LC3")) == 1
