"""MATLAB files as a script, a workspace and Simulink leave them: their signals and times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from fieldlink.site.errors import RecordingError
from fieldlink.site.recording import read_recording

N = 120
T = 2.0 * np.arange(N)
OP = 50.0 + 5.0 * np.sin(T / 9.0)
PV = 40.0 + 4.0 * np.sin(T / 9.0 - 0.5)


def logged(*signals: tuple[str, np.ndarray]) -> np.ndarray:
    """What Simulink keeps of signals beside the times: values and labels."""
    kept = [(values, label) for label, values in signals]
    return np.array(kept, dtype=[("values", "O"), ("label", "O")])


@pytest.mark.parametrize(
    "values",
    [
        {"loop": {"op": OP, "pv": PV}, "Ts": 2.0},
        {"loop": {"op": OP, "pv": PV}, "time": T},
        {"op": OP, "pv": PV, "Ts": 2.0, "about": {"op": "valve of FC101", "by": "shift B"}},
        {"tout": T, "op": OP, "pv": PV},
        {"out": {"tout": T, "op": OP, "pv": PV}},
        {"op": OP, "pv": PV, "fs": 0.5},
        {"ScopeData": {"time": T, "signals": logged(("OP", OP), ("PV", PV))}},
        {"ScopeData": {"time": T, "signals": logged(("OP", OP), ("PV", PV), ("SP", PV + 1.0))}},
    ],
)
def test_signals_and_times_of_matlab(values: dict[str, Any], tmp_path: Path) -> None:
    savemat(tmp_path / "loop.mat", values)
    found = read_recording(tmp_path / "loop.mat")
    assert found.period == pytest.approx(2.0)
    assert found.op == pytest.approx(OP)
    assert found.pv == pytest.approx(PV)


def test_signals_of_simulink_in_one_matrix_can_be_named(tmp_path: Path) -> None:
    both = {"values": np.column_stack([OP, PV]), "label": ""}
    savemat(tmp_path / "scope.mat", {"ScopeData": {"time": T, "signals": both}})
    with pytest.raises(RecordingError, match="signal1_1, signal1_2"):
        read_recording(tmp_path / "scope.mat")
    found = read_recording(tmp_path / "scope.mat", op="signal1_1", pv="signal1_2")
    assert found.period == pytest.approx(2.0)
    assert found.pv == pytest.approx(PV)


def test_times_of_another_length_are_not_left_out(tmp_path: Path) -> None:
    """A row was taken for a second."""
    savemat(tmp_path / "loop.mat", {"time": T[:-1], "op": OP, "pv": PV})
    said = f"time is a vector of {N - 1} samples, and other signals have {N}"
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / "loop.mat")


@pytest.mark.parametrize("rate", [0, -1.0, "0.5"])
def test_a_rate_that_is_none_is_asked_for(rate: object, tmp_path: Path) -> None:
    savemat(tmp_path / "loop.mat", {"op": OP, "pv": PV, "fs": rate})
    with pytest.raises(RecordingError, match="give the seconds between rows with --period"):
        read_recording(tmp_path / "loop.mat")
