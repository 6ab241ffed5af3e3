"""The speed benchmark runs end to end, and its bare loops do what they are compared for."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.bare_loops import in_cache, streamed
from benchmarks.estimator_speed import main


def test_bare_loops_multiply_and_add():
    rng = np.random.default_rng(1)
    signal, out = rng.normal(size=(50, 8)), np.zeros((50, 8))
    streamed(signal, 0.5, out)
    expected = np.zeros(8)
    for row in signal[1:]:
        expected = 0.5 * expected + row
    np.testing.assert_allclose(out[-1], expected)
    total = np.zeros(8)
    in_cache(np.array([1.0, 2.0, 3.0]), np.full(8, 0.5), total)
    np.testing.assert_allclose(total, 3.0 + 1.0 + 0.25)


@pytest.mark.slow
def test_it_writes_its_figures(tmp_path, capsys):
    options = ["--samples", "400", "--windows", "1", "--repeats", "1"]
    options += ["--grid-step", "3", "--starts", "0"]
    assert main([*options, "--out", str(tmp_path)]) == 0
    assert (tmp_path / "estimator_speed.md").read_text() == capsys.readouterr().out
    figures = json.loads((tmp_path / "estimator_speed.json").read_text())
    assert figures["windows per second, mean"] > 0.0
    assert figures["grid 3 over search"] > 0.0
