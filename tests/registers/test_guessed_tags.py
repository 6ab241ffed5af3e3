"""Types and word order guessed from one reading, against `struct`."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from fieldlink.registers import DataType, Table
from fieldlink.registers.guessed_tags import guess_tags

VALUES = (42.5, -3.25, 1013.0, 0.05)


@pytest.mark.parametrize("order", ["big", "little"])
def test_floats_counters_and_gaps(order: str) -> None:
    words = [3, 700]
    for value in VALUES:
        pair = struct.unpack(">2H", struct.pack(">f", value))
        words += pair if order == "big" else pair[::-1]
    known = {100 + number: word for number, word in enumerate(words)}
    known[200] = 0x4228  # alone: half of a value
    tags = guess_tags({Table.HOLDING: known, Table.INPUT: {0: 0, 1: 0}})
    floats = [tag for tag in tags if tag.data_type is DataType.FLOAT32]
    assert [tag.name for tag in floats] == ["H102", "H104", "H106", "H108"]
    assert {tag.word_order for tag in floats} == {order}
    read = [tag.decode([known[tag.address], known[tag.address + 1]]).value for tag in floats]
    assert read == pytest.approx(VALUES)
    others = [(tag.name, tag.data_type) for tag in tags if tag not in floats]
    names = ["H100", "H101", "H200", "I0", "I1"]
    assert others == [(name, DataType.UINT16) for name in names]


@pytest.mark.parametrize(("order", "before"), [("big", []), ("big", [4]), ("little", [])])
@pytest.mark.parametrize("set_point", [54.0, 54.3])
def test_floats_side_by_side_are_not_halved(
    order: str, before: list[int], set_point: float
) -> None:
    """OP, PV, SP, mode and counter: the halves of neighbours make floats of everyday sizes, too."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        words = list(before)
        for value in (rng.uniform(20.0, 80.0), rng.uniform(40.0, 60.0), set_point):
            pair = struct.unpack(">2H", struct.pack(">f", value))
            words += pair if order == "big" else pair[::-1]
        words += [5, int(rng.integers(1, 14_000)), 0, 0]
        tags = guess_tags({Table.HOLDING: dict(enumerate(words))})
        floats = [tag.address for tag in tags if tag.data_type is DataType.FLOAT32]
        assert floats == [len(before) + 2 * place for place in range(3)]
        assert {tag.word_order for tag in tags if tag.address in floats} == {order}
