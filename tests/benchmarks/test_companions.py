"""Areas of the practitioners' indices, on windows that were made up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.companions import companions
from benchmarks.recorded import Judged, Labelled
from estimator import identify


def _judged(op, pv, label):
    window = Labelled("a.csv", "a", "flow", label, None, 1.0, None, op, pv, None, None)
    return Judged(window, identify(op[:60], pv[:60]))


@pytest.fixture(scope="module")
def windows():
    k = np.arange(600)
    wave = np.sin(2.0 * np.pi * k / 50.0)
    noise = 0.05 * np.random.default_rng(0).normal(size=(4, 600))
    return [
        _judged(wave, np.sign(np.sin(2.0 * np.pi * (k - 12.5) / 50.0)) + noise[0], "stiction"),
        _judged(wave, np.sign(np.sin(2.0 * np.pi * (k - 11.5) / 50.0)) + noise[1], "stiction"),
        _judged(wave, -wave + noise[2], "no_stiction"),
        _judged(np.full(600, 3.0), noise[3], "no_stiction"),
    ]


def test_a_quarter_period_of_lag_tells_the_valve_for_horch_and_the_ellipse(windows) -> None:
    text, figures = companions(windows, windows)
    rows = {row["figure"]: row for row in figures["companions"]}
    assert rows["Horch, asymmetry of the cross-correlation"]["AUC, plant"] == 1.0
    assert rows["apparent stiction over OP's deviation"]["AUC, both"] == 1.0
    assert "| Horch, asymmetry" in text


def test_an_index_without_an_answer_is_counted(windows) -> None:
    _, figures = companions(windows, windows[2:] + windows[:1])
    rows = {row["figure"]: row for row in figures["companions"]}
    # OP that stands still draws no ellipse
    assert rows["apparent stiction over OP's deviation"]["no answer"] >= 1
    assert all(math.isfinite(row["AUC, ISDB"]) for row in rows.values())
