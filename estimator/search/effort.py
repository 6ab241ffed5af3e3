"""How much harder valves are looked for where the answer hangs on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.settings import Searching

__all__ = ["wider"]

_BANDS = 30
"""Stick bands of the coarse search in equal ratios of 1.14: a look follows a valve over an eighth
of S, and steps of 7 % of OP's span leave out most of the narrow ones."""
_SEEDS, _BASINS = (10, 6), (8, 4)
"""Valves that a look follows and hands on, of the first law and of each other one: the right one
may rank behind many wrong ones (tuning family: 6 and 4 leave one uncertain)."""
_PASTS = (3, 8, 16)
"""PV's own past, of clean records and of noisy ones."""
_POLISHED, _REFINED = 12, 10
"""Of all looks, valves whose process is fitted, and those refined: before its process is fitted the
right one may rank behind several wrong ones."""


def wider(searching: Searching) -> Searching:
    """The search with more stick bands, and with more valves followed to their end."""
    bands = np.geomspace(searching.bands[0], searching.bands[-1], _BANDS)
    return replace(
        searching,
        bands=tuple(float(band) for band in np.round(bands, 3)),
        pasts=_PASTS,
        seeds=_SEEDS,
        basins=_BASINS,
        polished=_POLISHED,
        refined=_REFINED,
    )
