"""ROC, and thresholds that the judged loop had no part in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from benchmarks.roc import auc, best_threshold, leave_one_loop_out, plot_roc, roc


def test_area_is_the_mann_whitney_statistic_ties_included():
    rng = np.random.default_rng(1)
    sticky = rng.random(60) < 0.4
    scores = np.round(rng.normal(size=60) + sticky, 1)
    u = mannwhitneyu(scores[sticky], scores[~sticky]).statistic
    assert auc(scores, sticky) == pytest.approx(u / (sticky.sum() * (~sticky).sum()))


def test_a_roc_needs_both_kinds():
    with pytest.raises(ValueError, match="3 of 3"):
        roc([1.0, 2.0, 3.0], [True, True, True])


def test_threshold_lies_in_the_middle_of_the_gap_on_a_logarithmic_scale():
    scores = [0.0, 2.0, 50.0, 200.0]
    assert best_threshold(scores, [False, False, True, True], list("abcd")) == pytest.approx(10.0)


def test_a_loop_counts_once_however_many_windows_it_has():
    # Ten windows of one healthy loop at 20 against two healthy loops at 2 and 3.
    scores = [2.0, 3.0, *[20.0] * 10, 10.0, 30.0, 40.0]
    sticky = [False] * 12 + [True] * 3
    loops = ["a", "b", *["c"] * 10, "d", "e", "f"]
    # By windows the best cut is above 20 (14 of 15 right); by loops all cuts from 3 to 10 win one
    # sticky loop for one healthy one, and the widest such gap is taken.
    by_loops = best_threshold(scores, sticky, loops)
    assert by_loops == pytest.approx(np.sqrt(3.0 * 10.0))


def test_a_loop_is_judged_by_the_others_alone():
    out = leave_one_loop_out(
        [1.0, 2.0, 100.0, 1.5, 90.0], [False, False, True, True, True], list("abcdd")
    )
    by_name = {one.loop: one for one in out}
    assert [one.loop for one in out] == ["a", "b", "c", "d"]
    # d's low window cannot pull the threshold that d is judged by.
    assert by_name["d"].threshold == pytest.approx(np.sqrt(2.0 * 100.0))
    assert (by_name["d"].windows, by_name["d"].right) == (2, 1)


def test_the_picture_is_written(tmp_path):
    plot_roc({"made up": roc([1.0, 2.0, 3.0], [False, True, True])}, tmp_path / "a" / "roc.png")
    assert (tmp_path / "a" / "roc.png").read_bytes().startswith(b"\x89PNG")
