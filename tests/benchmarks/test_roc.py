"""The area under the ROC curve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from benchmarks.roc import auc


def test_area_is_the_mann_whitney_statistic_ties_included() -> None:
    rng = np.random.default_rng(1)
    sticky = rng.random(60) < 0.4
    scores = np.round(rng.normal(size=60) + sticky, 1)
    u = mannwhitneyu(scores[sticky], scores[~sticky]).statistic
    assert auc(scores, sticky) == pytest.approx(u / (sticky.sum() * (~sticky).sum()))


def test_an_area_needs_both_kinds() -> None:
    with pytest.raises(ValueError, match="3 of 3"):
        auc([1.0, 2.0, 3.0], [True, True, True])
