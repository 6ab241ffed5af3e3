"""Loops that disturb each other, one kernel: PI(D) controllers, He's valve, two lags and a delay.

Times are in scans. A process has unit steady gain times ``gain``; an integrating one ramps by
``gain / lag`` a scan. Loop j's flow moves loop i's load by ``couple[i, j]``, through a lag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Loop", "Signals", "simulate"]

Floats = NDArray[np.float64]
_REST = 50.0


@dataclass(frozen=True)
class Loop:
    """One loop: process, controller (parallel times in scans), valve and what is put in.

    ``load`` is in percent of OP at the process's entry, ``wave`` and ``noise`` are in PV; the
    controller sees the noise. ``hand`` is NaN in automatic, else OP as set by hand. ``curve`` is
    the exponent of an equal-percentage valve, 0 for a linear one.
    """

    gain: float
    lag: float
    second: float
    delay: int
    integrating: bool
    kc: float
    ti: float
    td: float
    stick: float
    jump: float
    curve: float
    low: float
    high: float
    load: Floats
    wave: Floats
    noise: Floats
    sp: Floats
    hand: Floats


@dataclass(frozen=True)
class Signals:
    """OP, PV as the controller sees it and SP, each ``(loops, n)``."""

    op: Floats
    pv: Floats
    sp: Floats


@njit(cache=True)
def _flow(stem, curve):  # type: ignore[no-untyped-def]
    if curve == 0.0:
        return stem - 50.0
    return 100.0 / curve * (np.exp(curve * (stem - 50.0) / 100.0) - 1.0)


@njit(cache=True)
def _run(  # type: ignore[no-untyped-def]
    par, delay, integrating, load, wave, noise, sp, hand, couple, couple_lag, master
):
    loops, n = load.shape
    x1 = np.zeros(loops)
    x2 = np.zeros(loops)
    op = np.full(loops, 50.0)
    stem = np.full(loops, 50.0)
    moved = np.zeros((loops, loops))
    buffers = np.zeros((loops, delay.max() + 1))
    flow = np.zeros(loops)
    last_e = np.zeros(loops)
    older_pv = np.zeros(loops)
    last_pv = np.zeros(loops)
    out = np.empty((3, loops, n))
    for k in range(n):
        for i in range(loops):
            kc, ti, td = par[i, 3], par[i, 4], par[i, 5]
            pv = x2[i] + wave[i, k] + noise[i, k]
            target = sp[i, k]
            if master[i] >= 0:
                target += op[master[i]] - 50.0
            e = target - pv
            if np.isnan(hand[i, k]):
                change = kc * (e - last_e[i] + e / ti) if k > 0 else 0.0
                if td > 0.0 and k > 1:
                    change -= kc * td * (pv - 2.0 * last_pv[i] + older_pv[i])
                op[i] = min(max(op[i] + change, par[i, 9]), par[i, 10])
            else:
                op[i] = hand[i, k]
            last_e[i] = e
            older_pv[i], last_pv[i] = last_pv[i], pv
            out[0, i, k], out[1, i, k], out[2, i, k] = op[i], pv, target
            static = 0.5 * (par[i, 6] + par[i, 7])
            slide = 0.5 * (par[i, 6] - par[i, 7])
            gap = op[i] - stem[i]
            if gap > static:
                stem[i] = op[i] - slide
            elif gap < -static:
                stem[i] = op[i] + slide
            flow[i] = _flow(stem[i], par[i, 8])
        for i in range(loops):
            drive = flow[i] + load[i, k]
            if master[i] < 0:
                for m in range(loops):
                    if master[m] == i:
                        drive = x2[m] + load[i, k]
            for j in range(loops):
                if couple[i, j] != 0.0:
                    moved[i, j] += (flow[j] - moved[i, j]) / couple_lag[i, j]
                    drive += couple[i, j] * moved[i, j]
            place = k % (delay[i] + 1)
            buffers[i, place] = drive
            late = buffers[i, (place + 1) % (delay[i] + 1)]
            a = par[i, 0] * late
            if integrating[i]:
                x1[i] += a / par[i, 1]
            else:
                x1[i] += (a - x1[i]) * (1.0 - np.exp(-1.0 / par[i, 1]))
            if par[i, 2] > 0.05:
                x2[i] += (x1[i] - x2[i]) * (1.0 - np.exp(-1.0 / par[i, 2]))
            else:
                x2[i] = x1[i]
    return out


def simulate(
    loops: list[Loop],
    couple: Floats | None = None,
    couple_lag: Floats | None = None,
    master: NDArray[np.int64] | None = None,
) -> Signals:
    """Run the loops together.

    Args:
        loops: all of one length ``n``.
        couple, couple_lag: ``(loops, loops)``; row i says what moves loop i.
        master: the loop that sets each loop's set-point, -1 for none, ``(loops,)``.
    """
    m = len(loops)
    par = np.array(
        [
            [p.gain, p.lag, p.second, p.kc, p.ti, p.td, p.stick, p.jump, p.curve, p.low, p.high]
            for p in loops
        ]
    )
    out = _run(
        par,
        np.array([p.delay for p in loops]),
        np.array([p.integrating for p in loops]),
        np.array([p.load for p in loops]),
        np.array([p.wave for p in loops]),
        np.array([p.noise for p in loops]),
        np.array([p.sp for p in loops]),
        np.array([p.hand for p in loops]),
        np.zeros((m, m)) if couple is None else couple,
        np.ones((m, m)) if couple_lag is None else couple_lag,
        np.full(m, -1) if master is None else master,
    )
    return Signals(out[0], out[1] + _REST, out[2] + _REST)
