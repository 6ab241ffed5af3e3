"""Many values through a tag at once: the same as one after the other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldlink.registers import DataType, RegisterValueError, Table, Tag, read_back

_NUMBERS = [kind for kind in DataType if kind not in (DataType.STRING, DataType.BOOL)]
_VALUES = [
    *(0.0, -0.0, 1.0, 2.5, 3.5, -2.5, 0.05, 49.999999, 50.1234567, 1e-30),
    *(40_000.0, -40_000.0, 1e6, -7e9, 1e19, -1e19, 1e39, -1e39, 1e300, math.nan, 12.0),
]


def _one_by_one(tag: Tag, held: float) -> list[float]:
    """Store and decode value after value; NaN leaves an integer's registers alone."""
    result = []
    for value in _VALUES:
        if tag.data_type.is_float or not math.isnan(value):
            held = tag.decode(tag.encode(value, clamp=True)).value
        result.append(held)
    return result


@pytest.mark.parametrize("kind", _NUMBERS)
def test_each_type_rounds_and_saturates_as_one_value_does(kind: DataType) -> None:
    plain = Tag("T", Table.HOLDING, 0, kind)
    scaled = Tag("T", Table.HOLDING, 0, kind, scale=0.1, offset=-40.0)
    cut = Tag("T", Table.HOLDING, 0, kind, scale=-2.0, low=-5.0, high=3.0, clamp=True)
    for tag in (plain, scaled, cut):
        held = tag.decode(tag.encode(4.0, clamp=True)).value
        np.testing.assert_array_equal(read_back(tag, _VALUES, held), _one_by_one(tag, held))


def test_nothing_before_the_first_number_of_an_integer() -> None:
    tag = Tag("T", Table.HOLDING, 0, DataType.INT16)
    assert read_back(tag, [math.nan, math.nan, 3.0, math.nan], 7.0).tolist() == [7.0, 7.0, 3.0, 3.0]


def test_bits_and_bools() -> None:
    bit = Tag("T", Table.HOLDING, 0, DataType.BOOL, bit=3)
    assert read_back(bit, [0.0, 2.0, 0.0], 0.0).tolist() == [0.0, 1.0, 0.0]
    whole = Tag("T", Table.COIL, 0, DataType.BOOL)
    assert read_back(whole, [0.0, 5.0, math.nan, -1.0], 0.0).tolist() == [0.0, 1.0, 1.0, 0.0]
    with pytest.raises(RegisterValueError, match=r"T: 0\.5 is not a bool"):
        read_back(whole, [1.0, 0.5], 0.0)
    with pytest.raises(RegisterValueError, match="inf does not fit int16"):
        read_back(Tag("T", Table.HOLDING, 0, DataType.INT16), [math.inf], 0.0)
