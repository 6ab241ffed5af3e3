"""Readers of the published collections, on generated files of their layouts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks.readers import ReaderError, isdb_loops, read_isdb, read_sacac

OP = np.array([1.0, 2.0, 3.5])
PV = np.array([10.0, 20.0, 35.0])


def _isdb(path, **loop):
    savemat(path, {"cdata": {"chemicals": {"loop10": loop}, "power": {"loop4": loop}}})
    return path


def test_isdb_structure(tmp_path):
    path = _isdb(
        tmp_path / "isdb.mat",
        PV=PV[:, None],
        OP=OP[:, None],
        SP=np.full((3, 1), 20.0),
        Ts=1.0,
        comments="Pressure control loop, stiction",
    )
    assert isdb_loops(path) == ("chemicals.loop10", "power.loop4")
    loop = read_isdb(path, "chemicals.loop10")
    np.testing.assert_array_equal(loop.op, OP)
    np.testing.assert_array_equal(loop.pv, PV)
    np.testing.assert_array_equal(loop.sp, [20.0, 20.0, 20.0])
    assert loop.period_s == 1.0
    assert loop.comments == "Pressure control loop, stiction"


def test_isdb_row_vectors_scalar_set_point_and_unknown_period(tmp_path):
    path = _isdb(tmp_path / "a.mat", PV=PV[None, :], OP=OP, SP=7.0, Ts=np.nan, comments="")
    loop = read_isdb(path, "power.loop4")
    np.testing.assert_array_equal(loop.sp, [7.0, 7.0, 7.0])
    assert loop.period_s is None
    assert loop.comments == ""


def test_isdb_says_what_is_wrong(tmp_path):
    path = _isdb(tmp_path / "a.mat", PV=PV, OP=OP[:2])
    with pytest.raises(ReaderError, match=r"chemicals\.loop10"):
        read_isdb(path, "chemicals.loop11")
    with pytest.raises(ReaderError, match="one length"):
        read_isdb(path, "chemicals.loop10")
    other = tmp_path / "other.mat"
    savemat(other, {"x": 1.0})
    with pytest.raises(ReaderError, match="cdata"):
        read_isdb(other, "chemicals.loop10")
    text = tmp_path / "text.mat"
    text.write_text("op,pv\n")
    with pytest.raises(ReaderError, match="not a MATLAB file"):
        read_isdb(text, "chemicals.loop10")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "header", ["Time;PV;OP;SP", "t;pv (degC);Op [%];sp", "\ufefftime; PV ; OP ; SP"]
)
def test_sacac_line_ends_and_headers(tmp_path, end, header):
    rows = ["33:00.1;10;1;20", "33:01.1;20;2;20", "59:59.9;35;3.5;20"]
    path = tmp_path / "loop.csv"
    path.write_bytes(end.join([header, *rows, ""]).encode())
    loop = read_sacac(path, period_s=2.0)
    np.testing.assert_array_equal(loop.op, OP)
    np.testing.assert_array_equal(loop.pv, PV)
    np.testing.assert_array_equal(loop.sp, [20.0] * 3)
    assert loop.period_s == 2.0


def test_sacac_extra_columns_decimal_commas_gaps_and_no_set_point(tmp_path):
    path = tmp_path / "loop.csv"
    path.write_text("id;OP;note;PV\n1;1,5;x;10\n2;;y;nan\n3;2,5;z\n")
    loop = read_sacac(path)
    np.testing.assert_array_equal(loop.op, [1.5, np.nan, 2.5])
    np.testing.assert_array_equal(loop.pv, [10.0, np.nan, np.nan])
    assert loop.sp is None
    assert loop.period_s is None


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("time;pv\n1;2\n", "'OP'"),
        ("op;pv;OP\n1;2;3\n", "both named"),
        ("op;pv\n1;2\n3;broken\n", "row 3, column 'PV': 'broken'"),
        ("op;pv\n", "no rows"),
    ],
)
def test_sacac_says_what_is_wrong(tmp_path, content, part):
    path = tmp_path / "loop.csv"
    path.write_text(content)
    with pytest.raises(ReaderError, match=part):
        read_sacac(path)
