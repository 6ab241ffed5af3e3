"""Kano's method A: intervals in which OP moves and PV does not, and how far OP goes in them.

Source: Kano, Maruta, Kugemoto and Shimizu (2004), "Practical model and detection algorithm for
valve stiction", IFAC DYCOPS, 859-864. Made for flow or a measured stem. The paper leaves its
thresholds to the user; those here are chosen once, from the noise of the signals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.published.finding import Finding

__all__ = ["find_stuck_intervals"]

Array = NDArray[np.float64]

STICKY = 0.25
"""Share of the time in stuck intervals above which the valve counts as sticky (as Yamashita's)."""
REST = 3.0
"""PV rests while it stays within this many deviations of its noise."""
MOVES = 0.2
"""OP moves when it covers this share of its deviation."""


def _noise(signal: Array) -> float:
    """Deviation of white noise on a smooth signal, from its second differences."""
    bends = np.abs(np.diff(signal, 2))
    return float(np.median(bends)) / (0.6745 * np.sqrt(6.0))


def find_stuck_intervals(op: Array, pv: Array) -> Finding:
    """Return the share of time that PV is stuck as score, and S as OP's mean range meanwhile."""
    rest = max(REST * _noise(pv), 0.05 * float(pv.std()))
    moves = MOVES * float(op.std())
    if rest == 0.0 or moves == 0.0:
        return Finding("undecided", 0.0)
    ranges, stuck, start = [], 0, 0
    low = high = float(pv[0])
    for k in range(1, pv.size + 1):
        if k < pv.size:
            low_, high_ = min(low, float(pv[k])), max(high, float(pv[k]))
            if high_ - low_ <= 2.0 * rest:
                low, high = low_, high_
                continue
        reach = float(np.ptp(op[start:k]))
        if reach > moves and k - start > 2:
            ranges.append(reach)
            stuck += k - start
        if k < pv.size:
            start, low, high = k, float(pv[k]), float(pv[k])
    share = stuck / pv.size
    if not ranges or share <= STICKY:
        return Finding("no_stiction", share)
    return Finding("stiction", share, stick_band=float(np.mean(ranges)))
