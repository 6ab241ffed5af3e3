"""A mark that may group digits or begin decimals: the file proves which, or it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fieldlink.site import RecordingError, SiteError, read_recording, read_register_map
from fieldlink.site.map_import import import_map
from fieldlink.site.number_cells import find_decimal_mark, parse_numbers

N = 60
THOUSANDS = [990 + k for k in range(N)]
"""Below and above 1000."""


def write(folder: Path, mark: str, op: str, group: str) -> Path:
    path = folder / "loop.csv"
    rows = [
        mark.join((str(2 * k), op, f"{value:,}".replace(",", group)))
        for k, value in enumerate(THOUSANDS)
    ]
    path.write_text("\n".join([mark.join(("time", "op", "pv")), *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("mark", "op", "group"),
    [(";", "40,86", "."), ("\t", "40.86", ","), (";", "40.86", ","), ("\t", "40,86", ".")],
)
def test_another_column_proves_that_digits_are_grouped(
    mark: str, op: str, group: str, tmp_path: Path
) -> None:
    recording = read_recording(write(tmp_path, mark, op, group))
    assert recording.pv.tolist() == THOUSANDS
    assert recording.op[0] == 40.86


@pytest.mark.parametrize(("mark", "group"), [(";", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_digits_that_may_be_grouped_are_refused(mark: str, group: str, tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match=f"pv: '1{group}000' may be a decimal comma or grouped"
    ):
        read_recording(write(tmp_path, mark, "40", group))


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["1,005.5", "1,006"], [1005.5, 1006.0]),
        (["1.005.123", "1.006"], [1005123.0, 1006.0]),
        (["0,125", "1,250"], [0.125, 1.25]),
        (["1.125", "2.250"], [1.125, 2.25]),
        (["1,125", "2,250"], [1.125, 2.25]),
        (["1.250 kg/h", "998,5 kg/h", "1.001,5 kg/h"], [1250.0, 998.5, 1001.5]),
    ],
)
def test_a_column_tells_its_own_notation(cells: list[str], expected: list[float]) -> None:
    np.testing.assert_allclose(parse_numbers(cells, comma_separates=False).values, expected)


def test_two_notations_in_a_column_are_not_mixed() -> None:
    assert parse_numbers(["86,5", "1.005"], comma_separates=False).ambiguous == "1.005"
    assert parse_numbers(["1,005", "1.005"], comma_separates=False).ambiguous is not None
    assert dict(parse_numbers(["86,5", "86.25"], comma_separates=False).wrong) == {1: 1}


def test_what_proves_a_decimal_mark() -> None:
    assert find_decimal_mark(["1.005", "86,5"]) == ","
    assert find_decimal_mark(["1,005,000"]) == "."
    assert find_decimal_mark(["5.11.2026", "1.005", "992", "x"]) is None


@pytest.mark.parametrize("column", ["scale", "high"])
def test_a_register_map_with_grouped_digits_is_refused(column: str, tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text(f"tag;address;type;{column}\nPV;0;uint16;10,000\n")
    with pytest.raises(SiteError, match="'10,000' may be decimals or grouped digits; write 1000"):
        read_register_map(path)
    vendor = tmp_path / "vendor.csv"
    vendor.write_text(f"Register Name;Modbus Address;Data Type;{column}\nPV;40001;UINT;10,000\n")
    assert "may be decimals or grouped digits" in str(import_map(vendor).problems)


def test_digits_that_blanks_group_between_commas(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    rows = "".join(f"{2 * k},1 {600 + k},1 {700 + k}\n" for k in range(60))
    path.write_text("time,op,pv\n" + rows)
    found = read_recording(path)
    assert (found.op[3], found.pv[3], found.period) == (1603.0, 1703.0, 2.0)
    path.write_text(
        "time op pv\n" + "".join(f"{2 * k} 1,{600 + k} 1,{700 + k}\n" for k in range(60))
    )
    found = read_recording(path)
    assert (found.op[3], found.pv[3], found.period) == (1.603, 1.703, 2.0)
