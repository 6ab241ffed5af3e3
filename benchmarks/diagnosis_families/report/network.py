"""Loops of the report family side by side in one kernel: what flows from each into the others.

The same plant, valve and controller as in `report.parts`, stepped together; a plant of 40 loops
takes a fraction of a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.diagnosis_families.records import Floats
from benchmarks.diagnosis_families.report.parts import STEPS, Plant

__all__ = ["Put", "Unit", "run"]

_MIDDLE = 50.0


@dataclass
class Unit:
    """A loop of the plant: its process, PI settings, valve (S and J) and the loop it sets, if any.

    ``master_of`` is the loop whose set-point its OP is; a loop without one moves a valve.
    """

    plant: Plant
    kc: float
    ti: float
    stick: float = 0.0
    jump: float = 0.0
    master_of: int = -1


@dataclass(frozen=True)
class Put:
    """What is put into the loops, each ``(loops, n)`` but for the flows ``(loops, loops)``.

    ``share[i, j]`` of the flow of loop j reaches loop i through a lag of ``lag[i, j]`` samples.
    """

    load: Floats
    noise: Floats
    share: Floats
    lag: Floats


@njit(cache=True)
def _kano(u, stick, jump, valve):  # type: ignore[no-untyped-def]
    """Stem of Kano's valve; ``valve`` is stem, last OP, turning point, direction, stopped."""
    if stick <= 0.0:
        return u
    move = u - valve[1]
    if move * valve[3] <= 0.0 and move != 0.0 and valve[4] == 0.0:
        valve[4] = 1.0
        valve[2] = valve[1]
    if valve[4] == 1.0:
        away = u - valve[2]
        if away * valve[3] > jump and valve[3] != 0.0:
            valve[4] = 0.0
        elif abs(away) > stick:
            valve[3] = 1.0 if away > 0.0 else -1.0
            valve[4] = 0.0
    if valve[4] == 0.0 and move != 0.0:
        valve[0] = u - valve[3] * 0.5 * (stick - jump)
    valve[1] = u
    return valve[0]


@njit(cache=True)
def _run(a, b, c, late, settings, friction, order, master_of, load, noise, share, lag):  # type: ignore[no-untyped-def]
    m, n = load.shape
    x = np.zeros((m, 2))
    y = np.zeros(m)
    line = np.zeros((m, late.max() + 1))
    head = np.zeros(m, dtype=np.int64)
    state = np.full(m, _MIDDLE)
    target = np.zeros(m)
    flow = np.zeros(m)
    reached = np.zeros((m, m))
    valve = np.zeros((m, 5))
    valve[:, :3] = _MIDDLE
    valve[:, 4] = 1.0
    out = np.empty((3, m, n))
    for k in range(n):
        for i in order:
            pv = y[i] + noise[i, k]
            error = target[i] - pv
            state[i] += settings[i, 0] * error / settings[i, 1]
            wanted = state[i] + settings[i, 0] * error
            op = min(max(wanted, 0.0), 100.0)
            state[i] += op - wanted
            if master_of[i] >= 0:
                target[master_of[i]] = op - _MIDDLE
            flow[i] = _kano(op, friction[i, 0], friction[i, 1], valve[i]) - _MIDDLE
            out[0, i, k], out[1, i, k], out[2, i, k] = op, pv, target[i]
        for i in range(m):
            # a master acts through the PV of its slave
            into = load[i, k] + (y[master_of[i]] if master_of[i] >= 0 else flow[i])
            for j in range(m):
                if share[i, j] != 0.0:
                    reached[i, j] += (flow[j] - reached[i, j]) / lag[i, j]
                    into += share[i, j] * reached[i, j]
            for _ in range(STEPS):
                line[i, head[i]] = into
                head[i] = (head[i] + 1) % (late[i] + 1)
                old = line[i, head[i]]
                first = a[i, 0, 0] * x[i, 0] + a[i, 0, 1] * x[i, 1] + b[i, 0] * old
                x[i, 1] = a[i, 1, 0] * x[i, 0] + a[i, 1, 1] * x[i, 1] + b[i, 1] * old
                x[i, 0] = first
        for i in range(m):
            y[i] = c[i, 0] * x[i, 0] + c[i, 1] * x[i, 1]
    return out


def run(units: list[Unit], put: Put) -> tuple[Floats, Floats, Floats]:
    """OP, PV as the controller sees it and SP, each ``(loops, n)`` about mid-range."""
    order = sorted(range(len(units)), key=lambda i: units[i].master_of < 0)
    parts = [unit.plant.matrices() for unit in units]
    out = _run(
        np.array([a for a, _, _ in parts]),
        np.array([b for _, b, _ in parts]),
        np.array([c for _, _, c in parts]),
        np.array([unit.plant.line_length() for unit in units]),
        np.array([[unit.kc, unit.ti] for unit in units]),
        np.array([[unit.stick, unit.jump] for unit in units]),
        np.array(order, dtype=np.int64),
        np.array([unit.master_of for unit in units], dtype=np.int64),
        put.load,
        put.noise,
        put.share,
        np.maximum(1.0, put.lag),
    )
    found: tuple[NDArray[np.float64], ...] = (out[0], out[1] + 30.0, out[2] + 30.0)
    return found[0], found[1], found[2]
