"""How well a score separates sticky loops from healthy ones, whatever threshold is put on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["auc"]


def auc(scores: ArrayLike, sticky: ArrayLike) -> float:
    """Area under the ROC curve: how often a sticky window scores above a healthy one, a tie half.

    ``scores`` and labels ``sticky`` have shape ``(n,)``.

    Raises:
        ValueError: there is no sticky or no healthy window.
    """
    score, label = np.asarray(scores, dtype=np.float64), np.asarray(sticky, dtype=np.bool_)
    if label.all() or not label.any():
        raise ValueError(f"a ROC needs sticky and healthy windows; {label.sum()} of {label.size}")
    levels = np.unique(score)[::-1]
    alarmed = score[None, :] >= levels[:, None]
    true = np.concatenate([[0.0], alarmed[:, label].mean(axis=1)])
    false = np.concatenate([[0.0], alarmed[:, ~label].mean(axis=1)])
    return float(np.trapezoid(true, false))
